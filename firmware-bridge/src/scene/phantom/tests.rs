//! Throwaway picture.
use super::*;
#[test]
fn dump() {
    // three orthographic shaded views by ray marching the implicit itself
    let s = Scapula::default();
    let views: [(DVec3, DVec3, DVec3); 4] = [
        (DVec3::X, DVec3::Z, DVec3::Y),        // looking along +x: from behind
        (DVec3::NEG_X, DVec3::NEG_Z, DVec3::Y),   // from the front
        (DVec3::NEG_Z, DVec3::X, DVec3::Y),   // into the glenoid
        (DVec3::NEG_Y, DVec3::Z, DVec3::X),        // from above
    ];
    let n = 380usize;
    let mut img = vec![0u8; n * n * 4];
    img.chunks_mut(n*n).zip(views).for_each(|(im, (dir, right, up))| {
        im.par_chunks_mut(n).enumerate().for_each(|(y, row)| {
            for x in 0..n {
                let c = DVec3::new(0.0, -27.0, -38.0);
                let mut p = c + right * ((x as f64 - n as f64/2.0) * 0.45) + up * ((n as f64/2.0 - y as f64) * 0.45) - dir * 120.0;
                let mut hit = false;
                for _ in 0..400 { let v = s.value(p); if v > -0.02 { hit = true; break; } p += dir * (-v*0.6).clamp(0.03,6.0); if (p-c).length()>260.0 {break;} }
                row[x] = if hit { let g = -s.gradient(p); let g = g/g.length(); let l = (-dir*0.8+up*0.5-right*0.33); (40.0+ 200.0*(g.dot(l/l.length())).max(0.0)) as u8 } else { 15 };
            }
        });
    });
    std::fs::write("/tmp/h/views.raw", &img).unwrap();
    // gradient bound
    let mut worst: (f64,DVec3)=(0.0,DVec3::ZERO); let mut near: (f64,DVec3)=(9.0,DVec3::ZERO);
    let mut x=0u64; for i in 0..400000u64 { let r=|n:u64| random([i as f64, n as f64, 0.0], 5)*0.5+0.5; x+=1; let p=BOX.0+(BOX.1-BOX.0)*DVec3::new(r(1),r(2),r(3)); let g=s.gradient(p).length(); if g>worst.0 {worst=(g,p);} if s.value(p).abs()<1.5 && g<near.0 {near=(g,p);} }
    println!("worst {worst:?} near {near:?} {x}");
    let t0=std::time::Instant::now(); let mut acc=0.0; for i in 0..100000u64 { let r=|n:u64| random([i as f64, n as f64, 0.0], 5)*0.5+0.5; acc+=s.value(BOX.0+(BOX.1-BOX.0)*DVec3::new(r(1),r(2),r(3))); } println!("value {:?}/1e5 {acc}", t0.elapsed()); let mut a = SceneArgs::default();
    for h in [0.8,0.5] { a.voxel_mm=Some(h); let t=std::time::Instant::now(); let sc=load(&a,&mut |_,_|()).unwrap(); println!("{h} {:?} {:?}", t.elapsed(), sc.summary); }
}
