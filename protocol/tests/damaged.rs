//! Damage is refused, never taken for something else: a bounded run of what `examples/damage.rs` counts.
#![expect(
    unused,
    reason = "the program shows more of the counts than the test looks at"
)]

mod damage;

use damage::{Mistaken, Random, flips, random_bytes};

#[test]
fn no_damaged_frame_is_another_message_and_hfabs_lines_show_that_the_count_counts() {
    let mistaken = flips(&mut Random(1), 50_000);
    assert_eq!((mistaken.commands, mistaken.states), (0, 0));
    // a control: a format without a checksum is mistaken in more than one of twenty
    assert!(mistaken.hfab_commands > 2_500, "{mistaken:?}");
    assert!(mistaken.hfab_states > 2_500, "{mistaken:?}");
}

#[test]
fn random_bytes_are_survived_by_every_decoder() {
    let heard = random_bytes(&mut Random(2), 2_000_000);
    assert_eq!(heard.messages, 0, "{heard:?}");
    assert!(heard.refused > 10_000, "{heard:?}");
}
