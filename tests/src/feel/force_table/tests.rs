//! The law against itself, and the reader against planted rows.

use super::{Drill, by_elements, closed_form, compare, force_table, parse, table_file};
use crate::skipped;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::tissue::Tissue;

const HEADER: &str = "id,process,material,tool,spindle_rpm,feed,force_N_mean,force_N_sd_or_range,torque_Nmm_mean,torque_Nmm_sd_or_range,source,where_read";

fn one(row: &str) -> super::ForceRow {
    let records = parse(&format!("{HEADER}\n{row}\n")).expect("a table");
    compare(&records[0], &Feel::default())
}

/// Two ways to the same figures: an integral over the cone, and the sum over a tool's elements that the
/// contact solve takes. A drill's elements have one at its tip, of at most 1 % of the area; at the
/// smallest radius it weighs five times as much in the thrust, so thin drills are 5 % too stiff.
#[test]
fn closed_form_and_elements_agree() {
    let feel = Feel::default();
    for (diameter_mm, bound) in [(2.5, 0.06), (3.2, 0.04), (5.0, 0.03), (8.0, 0.02)] {
        for (rpm, feed_mm_s) in [(500.0, 0.5), (1000.0, 2.0), (1500.0, 1.0)] {
            let drill = Drill {
                diameter_mm,
                rpm,
                feed_mm_s,
            };
            let a = closed_form(&feel, Tissue::Cortical, 1.9, &drill);
            let b = by_elements(&feel, Tissue::Cortical, 1.9, &drill);
            let (force, torque) = (b.force_n / a.force_n, b.torque_nmm / a.torque_nmm);
            assert!((force - 1.0).abs() < bound, "{drill:?}: thrust x {force}");
            assert!((torque - 1.0).abs() < 0.01, "{drill:?}: torque x {torque}");
        }
    }
}

/// The hand's own sums of the design: a flat disc of 6 mm in cortical bone of 1.9 g/cm³ at 1 mm/s and
/// 1000/min needs 26 N and 39 N·mm (c = 1); a cone of 118° takes sin 59° of the viscous part.
#[test]
fn figures_by_hand() {
    let mut feel = Feel::default();
    feel.law.min_radius = 0.0;
    feel.law.edge_friction = 0.0;
    let drill = Drill {
        diameter_mm: 6.0,
        rpm: 1000.0,
        feed_mm_s: 1.0,
    };
    let found = closed_form(&feel, Tissue::Cortical, 1.9, &drill);
    let sine = 59f64.to_radians().sin();
    // A = 28.27 mm², u = 144.4 N/mm², ω = 104.72 rad/s
    let force = 28.274 * 0.01805 + 2.0 * 28.274 * 144.4 / (104.72 * 3.0) * sine;
    assert!((found.force_n - force).abs() < 0.01, "{found:?}");
    assert!(
        (found.torque_nmm - 144.4 * 28.274 / 104.72).abs() < 0.01,
        "{found:?}"
    );
}

#[test]
fn rows_are_read_and_sorted_out() {
    let full = one(
        "1,drilling,human femur cortical,3.2 mm drill,1000,120 mm/min,198.4,14.2,186.3,16.9,M,abstract",
    );
    assert!(full.applicable && full.assumed.is_empty());
    let force = full.published.force().expect("a range");
    assert!((force[0] - 184.2).abs() < 1e-9 && (force[1] - 212.6).abs() < 1e-9);
    assert_eq!(full.force_meets, Some(false));
    assert!(full.why.contains("chisel"), "{}", full.why);
    // one figure of everything is one figure of the law
    let law = full.law.expect("a law");
    assert!((law.force_n[1] - law.force_n[0]).abs() < 1e-9);
    assert!(full.ratio.force.expect("a ratio") < 0.2);

    let ranges =
        one("13,drilling,porcine femur,5.0 mm drill,500-1200,30-70 mm/min,,103-142 (fmax),,,J,a");
    assert_eq!(ranges.published.force(), Some([103.0, 142.0]));
    assert_eq!(ranges.published.torque(), None);
    assert!(ranges.assumed.is_empty());
    let law = ranges.law.expect("a law");
    assert!(law.force_n[1] > 2.0 * law.force_n[0], "{law:?}");

    let no_feed = one(
        "7,drilling (robot arm),bovine femur,2.5 mm drill,1000,,20.07,average of maxima,41.2,average of maxima,J,a",
    );
    assert_eq!(no_feed.assumed, ["feed 0.5 to 2 mm/s"]);
    assert_eq!(no_feed.published.force(), Some([20.07, 20.07]));
    let bare = one("17,drilling,human femoral trochanter (cancellous),,,,,1-1.5,,2-120,T,t");
    assert_eq!(bare.assumed.len(), 3);

    for (row, word) in [
        (
            "4,drilling,artificial femur,3.2 mm drill,1000,120 mm/min,87.2,19.3,67.2,8.4,M,a",
            "density",
        ),
        (
            "16,drilling,porcine marrow cavity,5.0 mm drill,,,0,close to zero,,,J,a",
            "marrow",
        ),
        ("19,drilling,porcine vertebra,,,,,0.6-29.6,,,P,t", "shares"),
        (
            "23,sawing (one tooth),bovine cortical,,,,,8-11 (resultant),,,J,a",
            "tooth",
        ),
        (
            "24,reaming (hip),human acetabulum,reamer,,,,over 300,,,P,i",
            "reaming",
        ),
        ("25,haptic device limit,Touch,,,,,up to 12,,,S,i", "device"),
    ] {
        let out = one(row);
        assert!(!out.applicable && out.law.is_none(), "{out:?}");
        assert!(out.why.contains(word), "{}", out.why);
    }
}

#[test]
fn a_table_that_is_not_understood_is_an_error() {
    for (text, word) in [
        ("a,b,c\n1,2,3".to_owned(), "line 1"),
        (format!("{HEADER}\n1,drilling,bone"), "line 2"),
        (format!("{HEADER}\n1,d,m,t,fast,,1,2,3,4,s,w"), "'fast'"),
        (
            format!("{HEADER}\n1,d,m,t,1000,2 inch/s,1,2,3,4,s,w"),
            "inch",
        ),
        (format!("{HEADER}\nx,d,m,t,1000,,1,2,3,4,s,w"), "row"),
    ] {
        let error = format!("{:#}", parse(&text).expect_err("an error"));
        assert!(error.contains(word), "{error}");
    }
}

/// The published table itself: every row is there, none is left without a reason.
#[test]
fn every_row_is_compared_or_explained() {
    if !table_file().is_file() {
        skipped("every_row_is_compared_or_explained: no force table; set OSTEON_DATA");
        return;
    }
    let rows = force_table(&Feel::default()).expect("the table");
    assert!(rows.iter().map(|r| r.row).eq(1..=25));
    let applicable: Vec<u32> = rows
        .iter()
        .filter(|r| r.applicable)
        .map(|r| r.row)
        .collect();
    assert_eq!(
        applicable,
        [1, 2, 3, 7, 8, 9, 10, 13, 14, 15, 17, 18, 20, 21, 22]
    );
    for row in &rows {
        assert!(row.why.len() > 20, "{row:?}");
        assert_eq!(row.law.is_some(), row.applicable);
        for ratio in [row.ratio.force, row.ratio.torque].into_iter().flatten() {
            assert!(ratio.is_finite() && ratio > 0.0, "{row:?}");
        }
        let json = serde_json::to_value(row).expect("JSON");
        assert_eq!(json["row"], row.row);
    }
}
