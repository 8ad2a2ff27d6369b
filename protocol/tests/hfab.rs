//! The lines of open Phantom-class controllers: golden bytes, strictness, total on any bytes.

use osteon_protocol::hfab::{HfabError, HfabState, LineReader, MAX_LINE, write_line};
use proptest::prelude::*;

fn read<const N: usize>(bytes: &[u8]) -> Vec<Result<[i32; N], HfabError>> {
    let mut reader = LineReader::<N>::new();
    bytes.iter().filter_map(|b| reader.push(*b)).collect()
}

#[test]
fn lines_as_the_firmware_prints_them() {
    // what sprintf("[%d,...]\n") of the public firmware gives for these numbers
    let line = b"[3,0,-6000,12,0,1023,-1,1024]\n";
    let numbers = [3, 0, -6000, 12, 0, 1023, -1, 1024];
    assert_eq!(read::<8>(line), [Ok(numbers)]);
    let mut out = [0; MAX_LINE];
    assert_eq!(write_line(&numbers, &mut out), line);
    let state = HfabState::new(numbers);
    assert_eq!((state.model, state.error), (3, 1024));
    assert_eq!(state.encoders, [0, -6000, 12, 0, 1023, -1]);
    assert_eq!(state.numbers(), numbers);
    assert_eq!(write_line(&[0, -2500, 2500], &mut out), b"[0,-2500,2500]\n");
}

#[test]
fn what_is_no_line_is_refused_and_the_next_one_is_read() {
    for (bad, why) in [
        ("[1,2]\n", HfabError::Count),
        ("[1,2,3,4]\n", HfabError::Count),
        ("[1,,3]\n", HfabError::Number),
        ("[1,2,]\n", HfabError::Number),
        ("[]\n", HfabError::Number),
        ("[1,2,-]\n", HfabError::Number),
        ("[1,-0,3]\n", HfabError::Number),
        ("[1,02,3]\n", HfabError::Number),
        ("[1,2147483648,3]\n", HfabError::Number),
        ("[1,99999999999,3]\n", HfabError::Number),
        ("[1,2 ,3]\n", HfabError::Byte),
        ("[1,+2,3]\n", HfabError::Byte),
        ("[1,2,3]x\n", HfabError::Byte),
        ("1,2,3]\n", HfabError::Byte),
    ] {
        let stream = format!("{bad}[7,8,9]\n");
        assert_eq!(
            read::<3>(stream.as_bytes()),
            [Err(why), Ok([7, 8, 9])],
            "{bad:?}"
        );
    }
    // a torn line takes only itself along
    assert_eq!(
        read::<3>(b"[1,2[7,8,9]\n"),
        [Err(HfabError::Byte), Ok([7, 8, 9])]
    );
    let least = [i32::MIN, i32::MAX, 0];
    let mut out = [0; MAX_LINE];
    assert_eq!(read::<3>(write_line(&least, &mut out)), [Ok(least)]);
    assert_eq!(read::<3>(b"\r\n\0[1,2,3]\r\n"), [Ok([1, 2, 3])]);
}

proptest! {
    #[test]
    fn numbers_make_the_round_trip(numbers: [i32; 8]) {
        let mut out = [0; MAX_LINE];
        prop_assert_eq!(read::<8>(write_line(&numbers, &mut out)), vec![Ok(numbers)]);
    }

    #[test]
    fn any_bytes_are_survived_and_a_whole_line_after_them_is_read(
        bytes in proptest::collection::vec(any::<u8>(), 0..300),
        numbers: [i32; 3],
    ) {
        let mut out = [0; MAX_LINE];
        let line = write_line(&numbers, &mut out);
        let found = read::<3>(&[&bytes[..], b"\n", line].concat());
        prop_assert_eq!(found.last(), Some(&Ok(numbers)));
    }
}
