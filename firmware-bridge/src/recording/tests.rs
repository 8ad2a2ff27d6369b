//! Session files: written, cut short, damaged, on a full disk; and replays that must fail.

#![expect(clippy::cast_possible_truncation, reason = "places in a small file")]

use super::file::SessionFile;
use super::sink::{State, Storage};
use super::*;
use crate::haptics::tests::{HELLO, Pair, setup_of};
use crate::haptics::wire_digest;
use crate::link::DeviceInfo;
use crate::replay::{Survey, verify};
use crate::scene::{SceneArgs, load};
use crate::tools::ToolArgs;
use osteon_protocol::session::{Setup, Tick};
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::Request;
use rtrb::RingBuffer;
use std::fs::File;
use std::io::{ErrorKind, Read as _, Seek as _, SeekFrom, Write};
use std::path::Path;

const TICKS: u32 = 4000;

/// From 6 mm before the joint to 4 mm beyond its surface and back every 1.6 s: in bone from 0.5 to 1.1 s.
fn pecking(seq: u16) -> f64 {
    let phase = f64::from(seq % 1600) / 80.0;
    6.0 - phase.min(20.0 - phase)
}

fn setup(tools: Option<&Path>) -> Setup {
    let scene_args = SceneArgs {
        voxel_mm: Some(1.2),
        ..SceneArgs::default()
    };
    let scene = load(&scene_args, &mut |_, _| {}).expect("the phantom");
    let poses = [
        bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
        scene.bone_from_plan,
    ];
    describe(&Begun {
        scene_args: &scene_args,
        tool_args: &ToolArgs {
            tools: tools.map(Path::to_owned),
        },
        scene: &scene,
        servo: &setup_of(&scene.bone, poses),
        device: &DeviceInfo::omni(&HELLO),
        link_name: "scripted",
    })
    .expect("a setup")
}

/// A session with checkpoints, undos and a reset; the recorder's ring holds `capacity` ticks.
fn session(blank: Blank, setup: Setup, capacity: usize) -> RecordingReport {
    let mut pair = Pair::over_phantom(1 << 14, pecking);
    let (ticks_in, ticks_out) = RingBuffer::new(capacity);
    pair.thread.recording = Some(Tap::new(ticks_in));
    let mut ring = Some(ticks_out);
    let mut recorder = None;
    for tick in 0..TICKS {
        // a recorder that is late finds a full ring
        if tick == 200 {
            let ring = ring.take().expect("a ring");
            recorder = Some(Recorder::start(blank, setup, ring).expect("a thread"));
            break;
        }
        pair.beat_at(u64::from(tick) * 1_000_000);
    }
    let recorder = recorder.expect("begun");
    for tick in 200..TICKS {
        let request = match tick {
            300 | 2000 | 2400 => Some(Request::Checkpoint),
            850 | 2500 => Some(Request::Undo),
            1500 => Some(Request::Reset),
            3300 => Some(Request::MotionScale(1.2)),
            _ => None,
        };
        if let Some(request) = request {
            pair.requests.push(request).expect("room");
        }
        pair.beat_at(u64::from(tick) * 1_000_000);
        pair.drain(usize::MAX);
        if tick % 700 == 699 {
            let bone = pair.thread.servo.bone();
            let digest = pair.mirror.cut.digest(bone);
            recorder.digest(u64::from(tick) + 1, wire_digest(digest));
        }
        // the recorder keeps up on a real clock
        if tick % 50 == 0 {
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    }
    pair.thread.servo.finish_carving();
    let digest = pair.thread.servo.cut().digest(pair.thread.servo.bone());
    assert!(digest.changed_chunks > 0 && digest.epoch == 3);
    recorder.finish(
        TICKS.into(),
        Some(wire_digest(digest)),
        "as asked".to_owned(),
    )
}

pub(crate) fn recorded(path: &Path) -> RecordingReport {
    session(Blank::new(path).expect("a file"), setup(None), RING_TICKS)
}

pub(crate) fn ticks_of(path: &Path) -> Vec<Tick> {
    let entries = Reader::open(path).expect("a session");
    let ticks = entries.filter_map(|entry| match entry.expect("an entry") {
        Entry::Tick(tick) => Some(*tick),
        Entry::Mark(_) => None,
    });
    ticks.collect()
}

#[test]
fn a_recording_is_played_to_the_same_bits_and_opens_in_the_containers_own_reader() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("session.mcap");
    let report = recorded(&path);
    assert_eq!((report.ticks, report.lost_ticks), (TICKS.into(), 0));
    assert_eq!(report.failed, None);
    assert_eq!(report.bytes, path.metadata().expect("a file").len());
    let verified = verify(&path, &Moved::default()).expect("equal");
    assert_eq!(verified.ticks, u64::from(TICKS));
    assert!(verified.end_digest && verified.digests == 6, "{verified:?}");
    assert_eq!(verified.ended.as_deref(), Some("as asked"));
    // index, channels and messages as the format's own crate reads them
    let bytes = std::fs::read(&path).expect("a file");
    let summary = mcap::Summary::read(&bytes).expect("an index").expect("one");
    let statistics = summary.stats.expect("statistics");
    let count = |topic: &str| {
        let (id, _) = summary
            .channels
            .iter()
            .find(|(_, c)| c.topic == topic)
            .expect("a channel");
        statistics.channel_message_counts[id]
    };
    assert_eq!(count("/osteon/ticks"), u64::from(TICKS));
    assert_eq!(count("/pose"), u64::from(TICKS) / 10);
    assert_eq!(count("/force"), u64::from(TICKS) / 10 + 1);
    assert!(count("/events") >= 7, "{}", count("/events"));
    let mut largest = 0.0f64;
    for message in mcap::MessageStream::new(&bytes).expect("a file") {
        let message = message.expect("a message");
        if message.channel.message_encoding == "json" {
            let json: serde_json::Value = serde_json::from_slice(&message.data).expect("JSON");
            let schema = message.channel.schema.as_ref().expect("a schema");
            let shape: serde_json::Value = serde_json::from_slice(&schema.data).expect("JSON");
            for key in json.as_object().expect("an object").keys() {
                assert!(
                    shape["properties"].get(key).is_some(),
                    "{key} is no part of {}",
                    schema.name
                );
            }
            largest = largest.max(json["largest_n"].as_f64().unwrap_or(0.0));
        }
    }
    // no peak is lost between two messages
    let length = |t: &Tick| t.outcome.force_n.iter().map(|v| v * v).sum::<f64>().sqrt();
    let truth = ticks_of(&path).iter().map(length).fold(0.0, f64::max);
    assert!(
        truth > 0.1 && (largest - truth).abs() < 1e-12,
        "{largest} {truth}"
    );
}

/// Ends of the chunks of a whole file, and the ticks up to each, by the container's written format.
fn chunks(bytes: &[u8], tick_channel: u16) -> Vec<(u64, u64)> {
    let number = |at: usize, size: usize| {
        let mut eight = [0; 8];
        eight[..size].copy_from_slice(&bytes[at..at + size]);
        u64::from_le_bytes(eight)
    };
    let (mut at, mut ticks, mut ends) = (8, 0, Vec::new());
    while at + 9 < bytes.len() {
        let (op, length) = (bytes[at], number(at + 1, 8) as usize);
        if op == 6 {
            // times 16, size 8, CRC 4, compression (empty) 4, length 8
            let mut inner = at + 9 + 40;
            while inner < at + 9 + length {
                let tick = bytes[inner] == 5 && number(inner + 9, 2) == u64::from(tick_channel);
                ticks += u64::from(tick);
                inner += 9 + number(inner + 1, 8) as usize;
            }
            ends.push(((at + 9 + length) as u64, ticks));
        }
        at += 9 + length;
    }
    ends
}

#[test]
fn a_file_cut_short_anywhere_gives_all_of_its_whole_chunks() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("session.mcap");
    recorded(&path);
    let bytes = std::fs::read(&path).expect("a file");
    let summary = mcap::Summary::read(&bytes).expect("an index").expect("one");
    let tick_channel = summary
        .channels
        .iter()
        .find(|(_, c)| c.topic == "/osteon/ticks");
    let ends = chunks(&bytes, *tick_channel.expect("a channel").0);
    assert!(ends.len() >= 8, "a chunk for half a second: {}", ends.len());
    assert_eq!(ends.last().expect("chunks").1, u64::from(TICKS));
    let all = ticks_of(&path);
    // random places in the last megabyte, from the end on
    let mut seed = 7u64;
    let most = bytes.len() as u64;
    let least = most.saturating_sub(1 << 20).max(ends[0].0);
    let mut places: Vec<u64> = (0..1000)
        .map(|_| {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            least + (seed >> 33) % (most - least)
        })
        .collect();
    places.sort_unstable();
    let file = File::options().write(true).open(&path).expect("a file");
    for (n, place) in places.iter().rev().enumerate() {
        file.set_len(*place).expect("cut");
        let survey = Survey::of(&path).expect("it opens");
        let whole = ends.iter().rev().find(|(end, _)| end <= place);
        assert_eq!(survey.ticks, whole.expect("a chunk").1, "cut at {place}");
        if n % 250 == 0 {
            let ticks = ticks_of(&path);
            assert!(ticks[..] == all[..ticks.len()]);
        }
    }
    let verified = verify(&path, &Moved::default()).expect("what is there is equal");
    assert!(verified.ended.is_none() && verified.cut_short.is_some());
    assert!(verified.ticks >= 400, "{}", verified.ticks);
}

#[test]
fn damage_anywhere_is_found_and_never_a_panic() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("session.mcap");
    recorded(&path);
    let good = ticks_of(&path);
    let length = path.metadata().expect("a file").len();
    let mut file = File::options()
        .read(true)
        .write(true)
        .open(&path)
        .expect("a file");
    let mut seed = 11u64;
    let mut found = 0;
    for _ in 0..300 {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        let place = (seed >> 24) % length;
        let mut byte = [0];
        file.seek(SeekFrom::Start(place)).expect("a place");
        file.read_exact(&mut byte).expect("a byte");
        let flipped = [byte[0] ^ 1 << (seed % 8)];
        file.seek(SeekFrom::Start(place)).expect("a place");
        file.write_all(&flipped).expect("written");
        // whatever is read is what was recorded
        if let Ok(mut reader) = Reader::open(&path) {
            let mut ticks = good.iter();
            for entry in reader.by_ref() {
                match entry {
                    Ok(Entry::Tick(tick)) => assert_eq!(ticks.next(), Some(&*tick), "{place}"),
                    Ok(Entry::Mark(_)) => {}
                    Err(_) => break,
                }
            }
            found += u32::from(ticks.next().is_some() || reader.cut_short().is_some());
        } else {
            found += 1;
        }
        file.seek(SeekFrom::Start(place)).expect("a place");
        file.write_all(&byte).expect("written");
    }
    // flips in the index at the end are no matter to a replay
    assert!(found > 200, "{found}");
    let mut junk = vec![0u8; 4096];
    for fill in [0u8, 0x89, 0xff] {
        junk.fill(fill);
        std::fs::write(&path, &junk).expect("written");
        let error = Reader::open(&path).expect_err("junk").to_string();
        assert!(error.contains("not an Osteon session"), "{error}");
    }
    let absent = Reader::open(&dir.path().join("absent")).expect_err("no file");
    assert!(absent.to_string().contains("cannot be read"));
}

struct SmallDisk {
    file: File,
    left: usize,
}

impl Write for SmallDisk {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.left == 0 {
            return Err(ErrorKind::StorageFull.into());
        }
        let count = bytes.len().min(self.left);
        self.left -= count;
        self.file.write(&bytes[..count])
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

impl Storage for SmallDisk {
    fn shorten(&mut self, len: u64) -> std::io::Result<()> {
        self.file.set_len(len)
    }
}

#[test]
fn a_full_disk_ends_the_recording_and_nothing_else() {
    let dir = tempfile::tempdir().expect("a folder");
    for (n, left) in [0, 1000, 600_000].into_iter().enumerate() {
        let path = dir.path().join(format!("{n}.mcap"));
        let file = File::create_new(&path).expect("a file");
        let disk = SmallDisk { file, left };
        let report = session(Blank::on(&path, Box::new(disk)), setup(None), RING_TICKS);
        let why = report.failed.expect("a reason");
        assert!(why.contains("storage space"), "{why}");
        assert_eq!(report.bytes, path.metadata().expect("a file").len());
        if left == 600_000 {
            let verified = verify(&path, &Moved::default()).expect("what is there is equal");
            assert_eq!(verified.ticks, report.ticks);
            assert!(verified.ticks > 500, "{verified:?}");
        }
    }
    // the system's own full disk
    let path = Path::new("/dev/full");
    let file = File::options().write(true).open(path).expect("a device");
    let report = session(Blank::on(path, Box::new(file)), setup(None), RING_TICKS);
    assert!(report.failed.expect("a reason").contains("No space left"));
}

#[test]
fn ticks_that_the_disk_was_too_slow_for_are_missed_aloud() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("session.mcap");
    let blank = Blank::new(&path).expect("a file");
    let report = session(blank, setup(None), 150);
    assert!(report.lost_ticks >= 50, "{report:?}");
    let survey = Survey::of(&path).expect("it opens");
    assert_eq!((survey.ticks, survey.lost), (150, report.lost_ticks));
    let error = verify(&path, &Moved::default()).expect_err("a gap");
    let text = error.to_string();
    assert!(
        text.contains("first 150 ticks are equal") && text.contains("too slow"),
        "{text}"
    );
}

/// The same session with something changed.
fn forged(from: &Path, to: &Path, change: impl Fn(&mut Setup, &mut Tick)) {
    let reader = Reader::open(from).expect("a session");
    let mut setup = reader.setup().clone();
    let mut entries: Vec<Entry> = reader.map(|e| e.expect("an entry")).collect();
    for entry in &mut entries {
        if let Entry::Tick(tick) = entry {
            change(&mut setup, tick);
        }
    }
    let file = Box::new(File::create(to).expect("a file"));
    let mut out = SessionFile::begin(file, State::default(), &setup).expect("begun");
    for entry in &entries {
        match entry {
            Entry::Tick(tick) => out.tick(tick).expect("written"),
            Entry::Mark(mark) => out.mark(0, mark).expect("written"),
        }
    }
    out.finish().expect("written");
}

fn one_bit(v: &mut f64) {
    *v = f64::from_bits(v.to_bits() ^ 1);
}

#[test]
fn a_replay_that_differs_in_one_bit_is_found() {
    let dir = tempfile::tempdir().expect("a folder");
    let (path, other) = (
        dir.path().join("session.mcap"),
        dir.path().join("other.mcap"),
    );
    recorded(&path);
    let fails = |change: &dyn Fn(&mut Setup, &mut Tick), words: &[&str]| {
        forged(&path, &other, change);
        let error = verify(&other, &Moved::default()).expect_err("a difference");
        let text = format!("{error:#}");
        for word in words {
            assert!(text.contains(word), "no '{word}' in {text}");
        }
    };
    forged(&path, &other, |_, _| {});
    verify(&other, &Moved::default()).expect("unchanged");
    let at = |n: u64, change: fn(&mut Tick)| {
        move |_: &mut Setup, tick: &mut Tick| {
            if tick.tick == n {
                change(tick);
            }
        }
    };
    // inputs
    let pushed = at(3100, |t| {
        t.sample.as_mut().expect("a sample").encoders[1] += 1;
    });
    fails(&pushed, &["tick 3100", "the stylus's pose"]);
    fails(&at(2500, |t| t.requests.clear()), &["tick 2500", "differs"]);
    fails(&at(3500, |t| t.sample = None), &["tick 3500", "differs"]);
    // what came out
    let force = at(3300, |t| one_bit(&mut t.outcome.force_n[2]));
    fails(&force, &["tick 3300", "the force"]);
    fails(
        &at(3301, |t| t.outcome.removed_by_class[3] += 1),
        &["tick 3301", "removed volume"],
    );
    fails(
        &at(3302, |t| t.outcome.torque[0] ^= 1),
        &["tick 3302", "torque"],
    );
    // parameters, bone, tools
    fails(
        &|setup, _| setup.force_limit_n = 0.05,
        &["differs from the recorded one"],
    );
    fails(
        &|setup, _| setup.bone_hash = 1,
        &["phantom", "is not the recorded one", "0000000000000001"],
    );
    fails(
        &|setup, _| setup.tool_hashes[1].1 = 2,
        &["the built-in tools", "reamer", "is not the recorded one"],
    );
    fails(
        &|setup, _| setup.feel[3].0 = "law.unknown".to_owned(),
        &["no parameter law.unknown"],
    );
    fails(&|setup, _| setup.version = 9, &["session format 9"]);
}

#[test]
fn a_file_that_has_changed_is_named_and_one_that_has_moved_is_found() {
    let dir = tempfile::tempdir().expect("a folder");
    let (path, tools) = (
        dir.path().join("session.mcap"),
        dir.path().join("tools.toml"),
    );
    let standard = include_str!("../../tools/standard.toml");
    std::fs::write(&tools, standard).expect("written");
    let blank = Blank::new(&path).expect("a file");
    session(blank, setup(Some(&tools)), RING_TICKS);
    verify(&path, &Moved::default()).expect("equal");
    std::fs::write(&tools, format!("{standard}\n# a word\n")).expect("written");
    let error = verify(&path, &Moved::default())
        .expect_err("changed")
        .to_string();
    for word in ["tools.toml", "is not the file of the recording", "--tools"] {
        assert!(error.contains(word), "{error}");
    }
    std::fs::remove_file(&tools).expect("removed");
    let error = format!("{:#}", verify(&path, &Moved::default()).expect_err("gone"));
    assert!(
        error.contains("tools.toml") && error.contains("--tools"),
        "{error}"
    );
    let elsewhere = dir.path().join("elsewhere.toml");
    std::fs::write(&elsewhere, standard).expect("written");
    let moved = Moved {
        tools: Some(elsewhere),
        ..Moved::default()
    };
    verify(&path, &moved).expect("equal");
}

#[test]
fn a_recording_is_never_written_over_and_knows_every_parameter() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("session.mcap");
    std::fs::write(&path, "dear").expect("written");
    let error = Blank::new(&path).err().expect("refused").to_string();
    assert!(error.contains("is there already"), "{error}");
    assert_eq!(std::fs::read(&path).expect("a file"), b"dear");
    let nowhere = Blank::new(&dir.path().join("no/where"))
        .err()
        .expect("refused");
    assert!(nowhere.to_string().contains("cannot be written"));
    let setup = setup(None);
    let bytes = |setup: &Setup| {
        let mut bytes = Vec::new();
        osteon_protocol::session::encode(setup, &mut bytes).expect("encoded");
        bytes
    };
    let again: Setup = osteon_protocol::session::decode(&bytes(&setup)).expect("decoded");
    assert_eq!(again, setup);
}
