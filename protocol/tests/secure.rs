//! The handshake and the records of the viewer link over a network: who gets in, and what does not.
#![expect(
    clippy::unwrap_used,
    reason = "a helper that fails is a test that fails"
)]

use osteon_protocol::secure::{
    Answered, CALL_BYTES, Call, Identity, MAX_RECORD, MAX_SEALED, Opener, PublicKey, Sealer,
    SecureError, answer,
};
use proptest::prelude::*;

struct Pair {
    viewer: (Sealer, Opener),
    haptics: Answered,
}

fn pair() -> Pair {
    let (viewer, haptics) = (Identity::generate().unwrap(), Identity::generate().unwrap());
    let (call, bytes) = Call::begin(&viewer, haptics.public()).unwrap();
    let answered = answer(&haptics, &bytes, |key| key == viewer.public()).unwrap();
    assert_eq!(answered.caller, viewer.public());
    let viewer = call.end(&answered.answer).unwrap();
    Pair {
        viewer,
        haptics: answered,
    }
}

fn open(opener: &mut Opener, bytes: &[u8]) -> Result<Vec<u8>, SecureError> {
    let mut plain = Vec::new();
    let mut rest = bytes;
    loop {
        let count = rest.len().min(opener.room());
        opener.push(&rest[..count]);
        rest = &rest[count..];
        if !opener.next(&mut plain)? && rest.is_empty() {
            return Ok(plain);
        }
    }
}

#[test]
fn both_ways_whatever_the_size() {
    let Pair {
        viewer: (mut out, mut back),
        haptics: mut far,
    } = pair();
    for size in [1, 2, 4096, MAX_RECORD, MAX_RECORD + 1, 3 * MAX_RECORD + 5] {
        let plain: Vec<u8> = (0..=250).cycle().take(size).collect();
        let (mut sealed, mut done) = (Vec::new(), 0);
        while done < size {
            done += out.seal(&plain[done..], &mut sealed).unwrap();
        }
        assert_eq!(open(&mut far.opener, &sealed).unwrap(), plain);
        // readable by nobody on the way
        assert!(size < 64 || !sealed.windows(64).any(|w| w == &plain[..64]));
        let mut answer = Vec::new();
        far.sealer.seal(&plain, &mut answer).unwrap();
        let most = size.min(MAX_RECORD);
        assert_eq!(open(&mut back, &answer).unwrap(), plain[..most]);
        assert!(answer.len() <= MAX_SEALED);
    }
}

#[test]
fn a_stranger_and_a_wrong_haptics_process_get_nowhere() {
    let [viewer, haptics, other] = [(); 3].map(|()| Identity::generate().unwrap());
    let (_, bytes) = Call::begin(&viewer, haptics.public()).unwrap();
    let nobody = answer(&haptics, &bytes, |_| false);
    assert_eq!(nobody.err(), Some(SecureError::Stranger));
    let elsewhere = answer(&other, &bytes, |_| true);
    assert_eq!(elsewhere.err(), Some(SecureError::Handshake));
    // somebody in the middle who answers with a key of his own
    let (call, _) = Call::begin(&viewer, haptics.public()).unwrap();
    let (_, to_other) = Call::begin(&viewer, other.public()).unwrap();
    let forged = answer(&other, &to_other, |_| true).unwrap();
    assert_eq!(call.end(&forged.answer).err(), Some(SecureError::Handshake));
}

#[test]
fn a_repeated_call_opens_no_record() {
    let (viewer, haptics) = (Identity::generate().unwrap(), Identity::generate().unwrap());
    let (call, bytes) = Call::begin(&viewer, haptics.public()).unwrap();
    let first = answer(&haptics, &bytes, |_| true).unwrap();
    let (mut sealer, _) = call.end(&first.answer).unwrap();
    let mut record = Vec::new();
    sealer.seal(b"stop", &mut record).unwrap();
    // call and record were overheard and are played back
    let mut second = answer(&haptics, &bytes, |_| true).unwrap();
    let played = open(&mut second.opener, &record);
    assert_eq!(played, Err(SecureError::Record));
}

#[test]
fn records_come_once_and_in_order() {
    let mut pair = pair();
    let (mut first, mut second) = (Vec::new(), Vec::new());
    pair.viewer.0.seal(b"first", &mut first).unwrap();
    pair.viewer.0.seal(b"second", &mut second).unwrap();
    assert_eq!(open(&mut pair.haptics.opener, &first).unwrap(), b"first");
    let again = open(&mut pair.haptics.opener, &first);
    assert_eq!(again, Err(SecureError::Record));
    let mut pair = self::pair();
    let mut late = Vec::new();
    pair.viewer.0.seal(b"a", &mut Vec::new()).unwrap();
    pair.viewer.0.seal(b"b", &mut late).unwrap();
    let skipped = open(&mut pair.haptics.opener, &late);
    assert_eq!(skipped, Err(SecureError::Record));
    // one's own record played back to one
    let mut own = Vec::new();
    pair.haptics.sealer.seal(b"c", &mut own).unwrap();
    let reflected = open(&mut pair.haptics.opener, &own);
    assert_eq!(reflected, Err(SecureError::Record));
}

#[test]
fn keys_as_text() {
    let own = Identity::generate().unwrap();
    assert_eq!(
        Identity::from_secret_hex(&own.secret_hex()),
        Some(own.clone())
    );
    let public = own.public();
    assert_eq!(PublicKey::from_hex(&public.to_hex()), Some(public));
    let text = public.to_hex();
    for bad in [
        "",
        "0",
        &text[1..],
        &format!("{text}00"),
        &text.replace(&text[..1], "g"),
        "é",
    ] {
        assert_eq!(PublicKey::from_hex(bad), None, "{bad}");
    }
    assert!(!format!("{own:?}").contains(&own.secret_hex()));
    // RFC 7748, 5.2: the base point times 9, after one iteration
    let nine = format!("09{}", "00".repeat(31));
    let nine = Identity::from_secret_hex(&nine).unwrap();
    assert_eq!(
        nine.public().to_hex(),
        "422c8e7a6227d7bca1350b3e2bb7279f7897b87bb6854b783c60e80311ae3079"
    );
}

proptest! {
    #[test]
    fn random_calls_and_records_never_panic(
        call in prop::collection::vec(any::<u8>(), CALL_BYTES),
        bytes in prop::collection::vec(any::<u8>(), 0..600),
    ) {
        let own = Identity::from_secret([7; 32]).unwrap();
        let call: [u8; CALL_BYTES] = call.try_into().unwrap();
        prop_assert!(answer(&own, &call, |_| true).is_err());
        let mut pair = pair();
        // nothing comes out of noise
        prop_assert_ne!(open(&mut pair.haptics.opener, &bytes).map_or(0, |p| p.len()), 1);
        let opened = open(&mut pair.viewer.1, &bytes).unwrap_or_default();
        prop_assert!(opened.is_empty());
    }

    #[test]
    fn every_bit_of_a_record_and_of_the_handshake_counts(at in any::<prop::sample::Index>(), bit in 0u32..8) {
        let mut pair = pair();
        let mut record = Vec::new();
        pair.viewer.0.seal(b"a wish of the viewer", &mut record).unwrap();
        let at_record = at.index(record.len());
        record[at_record] ^= 1u8 << bit;
        let opened = open(&mut pair.haptics.opener, &record);
        // a length that grew waits for more
        prop_assert!(opened.is_err() || opened == Ok(Vec::new()));
        let (viewer, haptics) = (Identity::generate().unwrap(), Identity::generate().unwrap());
        let (_, mut call) = Call::begin(&viewer, haptics.public()).unwrap();
        call[at.index(CALL_BYTES)] ^= 1u8 << bit;
        prop_assert!(answer(&haptics, &call, |k| k == viewer.public()).is_err());
    }
}
