//! How the device link's frames and hfab's lines bear damage:
//! `cargo run --release -p osteon-protocol --example damage [FLIPS] [FUZZED_BYTES]`.
//!
//! Flips single and several bits of sound messages, in both directions, and counts those that are read as
//! *another* message; then feeds random bytes to every decoder, which must not panic. hfab's lines have no
//! checksum; what they let through is counted beside it.
#![expect(clippy::print_stdout, reason = "a program that shows its figures")]

#[path = "../tests/damage/mod.rs"]
mod damage;

use damage::{Random, flips, random_bytes};

fn main() {
    let number = |n: usize, usual: u64| {
        let given = std::env::args().nth(n);
        given.and_then(|text| text.parse().ok()).unwrap_or(usual)
    };
    let (count, bytes) = (number(1, 10_000_000), number(2, 100_000_000));
    let mut random = Random(1);
    let mistaken = flips(&mut random, count);
    println!("of {count} damaged messages each, read as another:");
    println!(
        "  {:>9} commands, {:>9} states: COBS and CRC-32C",
        mistaken.commands, mistaken.states
    );
    println!(
        "  {:>9} commands, {:>9} states: hfab's lines",
        mistaken.hfab_commands, mistaken.hfab_states
    );
    let heard = random_bytes(&mut random, bytes);
    println!(
        "{bytes} random bytes: {} frames refused, {} taken for messages; {} lines and {} raw payloads, which have no \
         checksum, taken; no panic",
        heard.refused, heard.messages, heard.lines, heard.raw
    );
}
