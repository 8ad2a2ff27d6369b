use super::*;

#[test]
fn scratch() {
    use super::setup::Spec;
    let t = std::time::Instant::now();
    for (b, f) in [(0.1, 0.03), (0.1, 0.1), (0.1, 0.26)] {
        let ks: Vec<f64> = (0..=3)
            .map(|d| {
                let mut s = Spec::flat().with(Hand::NONE, d);
                s.plant.viscous_n_s_per_m = b;
                s.plant.coulomb_n = f;
                map::largest(|k| press::settled(&press::pressed_wall(&s.clone().stiff(k), 10.0)))
            })
            .collect();
        println!("wall b {b} f {f} {ks:.3?} {:?}", t.elapsed());
    }
    for b in [0.1, 0.5, 1.0] {
        for d in 0..=3 {
            let law = map::delay_law_n_per_m(b, d);
            let s = map::linear(b, d);
            println!("onset b {b} d {d}: wall {:.1} servo {:.1} law {law:.1} {:?}", map::onset_n_per_m(&s, Bench::with_wall), map::onset_n_per_m(&s, Bench::new), t.elapsed());
        }
    }
    for r in map::stiffness_map() { println!("{r:?}"); }
    println!("{:?}", t.elapsed());
}
