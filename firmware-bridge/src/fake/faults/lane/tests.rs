use super::*;
use crate::fake::faults::CATALOGUE;
use crate::fake::faults::catalogue::Where;

const MS: u64 = 1_000_000;

/// Frame number `n`, told by its first byte.
fn frame(n: u8) -> Vec<u8> {
    let mut frame = vec![n + 1; 12];
    frame.push(0);
    frame
}

/// Sends a frame a millisecond, the fault from the tenth on; what came in each millisecond.
fn ride(fault: Option<Fault>, seed: u64) -> Vec<Vec<u8>> {
    let mut lane = Lane::new(MS / 5);
    let mut came = Vec::new();
    for n in 0..200_u8 {
        let now = u64::from(n) * MS;
        if n == 10
            && let Some(fault) = fault
        {
            lane.inject(fault, now, seed);
        }
        lane.put(now, &frame(n));
        let mut out = Vec::new();
        lane.take(now + MS / 2, &mut out);
        came.push(out);
    }
    came
}

fn numbers(came: &[Vec<u8>]) -> Vec<u8> {
    came.concat()
        .split(|&b| b == 0)
        .filter(|f| f.len() == 12 && f.iter().all(|&b| b == f[0]))
        .map(|f| f[0] - 1)
        .collect()
}

#[test]
fn a_sound_lane_delivers_every_byte_in_order_and_in_time() {
    let came = ride(None, 0);
    for (n, bytes) in (0..).zip(&came) {
        assert_eq!(*bytes, frame(n));
    }
}

#[test]
fn single_faults_cost_the_frame_they_meet_and_at_most_the_next() {
    for entry in CATALOGUE.iter().filter(|e| e.place == Where::Lane) {
        let single = entry.lasts_ms == 0 && !is_for_good(entry.fault);
        if !single {
            continue;
        }
        for seed in 0..50 {
            let whole = numbers(&ride(Some(entry.fault), seed));
            let lost: Vec<u8> = (0..200).filter(|n| !whole.contains(n)).collect();
            assert!(lost.len() <= 2, "{} {seed}: {lost:?}", entry.name);
            assert!(lost.iter().all(|n| (10..=11).contains(n)), "{lost:?}");
        }
    }
}

#[test]
fn the_lasting_ones_last_as_long_as_they_say() {
    let whole = |fault| numbers(&ride(Some(fault), 3));
    let all: Vec<u8> = (0..200).collect();
    let without = |from: u8, until: u8| -> Vec<u8> {
        (0..200).filter(|n| !(from..until).contains(n)).collect()
    };
    assert_eq!(whole(Fault::DropFrames), without(10, 110));
    assert_eq!(whole(Fault::Gap4), without(10, 14));
    assert_eq!(whole(Fault::StopSending), without(10, 160));
    for fault in [Fault::Split, Fault::Merge, Fault::Burst, Fault::StopReading] {
        assert_eq!(whole(fault), all, "{fault}");
    }
    let flipped = whole(Fault::FlipBits);
    assert!(flipped.len() < 110, "{}", flipped.len());
    let mut twice = whole(Fault::Duplicate);
    twice.dedup();
    assert_eq!(twice, all);
    let mut pairs = whole(Fault::Reorder);
    assert_eq!(pairs[10..14], [11, 10, 13, 12]);
    pairs.sort_unstable();
    assert_eq!(pairs, all);
}

#[test]
fn what_waits_comes_when_it_should() {
    let arrival = |fault, n: u8| {
        let came = ride(Some(fault), 3);
        came.iter()
            .position(|bytes| numbers(std::slice::from_ref(bytes)).contains(&n))
    };
    assert_eq!(arrival(Fault::Delay5, 10), Some(15));
    assert_eq!(arrival(Fault::Delay20, 50), Some(70));
    assert_eq!(arrival(Fault::Delay150, 10), Some(160));
    for n in [10, 40, 69] {
        assert_eq!(arrival(Fault::Burst, n), Some(70), "{n}");
        assert_eq!(arrival(Fault::StopReading, n), Some(160), "{n}");
    }
    assert_eq!(arrival(Fault::Merge, 10), Some(11));
}

#[test]
fn the_same_seed_breaks_the_same_bits() {
    assert_eq!(
        ride(Some(Fault::FlipBits), 7),
        ride(Some(Fault::FlipBits), 7)
    );
    assert_ne!(
        ride(Some(Fault::FlipBits), 7),
        ride(Some(Fault::FlipBits), 8)
    );
}
