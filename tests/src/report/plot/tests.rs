use super::*;

#[test]
fn a_plot_writes_its_picture_and_its_points() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut plot = Plot::new("p", "A plot", "", ["voxel, mm", "time, µs"]);
    plot.series("a")
        .extend([Point::at(0.5, 10.0), Point::median(1.0, &[3.0, 1.0, 2.0])]);
    plot.series("b").push(Point::median(1.0, &[f64::NAN]));
    plot.slopes.push((-3.0, "slope -3".to_owned()));
    plot.levels.push((20.0, "a floor".to_owned()));
    plot.write(dir.path()).expect("written");
    let csv = std::fs::read_to_string(dir.path().join("p.csv")).expect("a table");
    assert_eq!(
        csv,
        "series,\"voxel, mm\",\"time, µs\",low,high,failed\n\
         a,0.5,10,,,false\na,1,2,1,3,false\nb,1,,,,true\n"
    );
    let svg = std::fs::read_to_string(dir.path().join("p.svg")).expect("a picture");
    for word in ["A plot", "time, µs", "slope -3", "a floor", "<circle"] {
        assert!(svg.contains(word), "{word}");
    }
}

#[test]
fn an_empty_plot_is_no_error() {
    let dir = tempfile::tempdir().expect("a folder");
    let plot = Plot::new("p", "Nothing", "", ["x", "y"]);
    plot.write(dir.path()).expect("written");
}

#[test]
fn other_axes_draw_zeros_negatives_and_laws() {
    let dir = tempfile::tempdir().expect("a folder");
    let mut plot =
        Plot::new("p", "Linear", "", ["tilt", "ripple"]).on([Scale::Linear, Scale::Linear]);
    plot.series("a").extend([
        Point::at(0.0, -1.0),
        Point::at(1.0, 0.0),
        Point::at(2.0, 4.0),
    ]);
    plot.curves
        .push((vec![[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], "a law".to_owned()));
    plot.slopes.push((1.0, "not here".to_owned()));
    plot.write(dir.path()).expect("written");
    let svg = std::fs::read_to_string(dir.path().join("p.svg")).expect("a picture");
    assert_eq!(
        svg.matches("<circle").count(),
        4,
        "three points and the legend's"
    );
    assert!(svg.contains("a law") && !svg.contains("not here"));
}
