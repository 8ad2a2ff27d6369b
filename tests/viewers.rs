//! What a viewer does never reaches the servo: stalls, deaths, silence, garbage, floods.
#![expect(
    clippy::expect_used,
    clippy::items_after_statements,
    clippy::panic,
    reason = "what goes wrong here is a failed test"
)]

use interprocess::local_socket::traits::Stream as _;
use interprocess::local_socket::{GenericFilePath, Stream, ToFsName as _};
use osteon_protocol::ipc::{
    Command, Digest, FromViewer, IPC_VERSION, Join, PoseUpdate, Role, Scene, ToViewer, capability,
};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into, unpack_bricks, unpack_piece};
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_tests::{fake, haptics, json, number, one_at_a_time, run, socket, stroke, text, until};
use std::io::{ErrorKind, Read as _, Write as _};
use std::path::Path;
use std::time::{Duration, Instant};

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
const LIMIT: Duration = Duration::from_secs(30);

/// A viewer of a third party: nothing but the documented bytes.
struct Client {
    stream: Stream,
    decoder: StreamDecoder,
}

impl Client {
    fn connect(dir: &Path) -> Self {
        let path = socket(dir);
        let name = path
            .as_path()
            .to_fs_name::<GenericFilePath>()
            .expect("a name");
        let stream = Stream::connect(name).expect("a connection");
        stream.set_recv_timeout(Some(LIMIT)).expect("a time limit");
        stream.set_send_timeout(Some(LIMIT)).expect("a time limit");
        Self {
            stream,
            decoder: StreamDecoder::new(),
        }
    }

    fn hello(dir: &Path, name: &str) -> Self {
        let mut client = Self::connect(dir);
        client.say(&FromViewer::Hello {
            version: IPC_VERSION,
            name: name.to_owned(),
        });
        client.say(&FromViewer::Join(Join {
            role: Role::Trainee,
            capabilities: capability::ALL,
            pose_hz: 125,
            resume: None,
        }));
        client
    }

    fn say(&mut self, message: &FromViewer) {
        let mut bytes = Vec::new();
        encode_into(message, &mut bytes).expect("a message");
        (&self.stream).write_all(&bytes).expect("sent");
    }

    /// The next message; `None` where the other side closed.
    fn hear(&mut self) -> Option<ToViewer> {
        let mut buffer = vec![0; 65_536];
        loop {
            if let Some(message) = self.decoder.next().expect("valid messages") {
                return Some(message);
            }
            match (&self.stream).read(&mut buffer) {
                Ok(0) => return None,
                Err(e) if e.kind() == ErrorKind::ConnectionReset => return None,
                Err(e) => panic!("nothing heard: {e}"),
                Ok(n) => self.decoder.push(&buffer[..n]),
            }
        }
    }

    /// Hears messages until `wanted` gives something.
    fn until<T>(&mut self, mut wanted: impl FnMut(&ToViewer) -> Option<T>) -> T {
        let end = Instant::now() + LIMIT;
        while Instant::now() < end {
            let message = self.hear().expect("still connected");
            if let Some(found) = wanted(&message) {
                return found;
            }
        }
        panic!("not heard within {LIMIT:?}");
    }
}

/// Bone and cut as the client has them.
struct Mirror {
    bone: Bone,
    cut: Cut,
}

impl Mirror {
    /// Takes the whole bone.
    fn receive(client: &mut Client) -> Self {
        let scene: Scene = client.until(|m| match m {
            ToViewer::Scene(scene) => Some((**scene).clone()),
            _ => None,
        });
        let grid = Grid::new(scene.dims.map(|n| n as usize), scene.spacing_mm.into());
        let mut bone = Bone::new(grid.expect("a grid"), Pose::IDENTITY);
        while bone.chunk_count() < scene.chunks as usize {
            let piece = client.until(|m| match m {
                ToViewer::BonePiece(piece) => Some(piece.clone()),
                _ => None,
            });
            let values = unpack_piece(&piece).expect("a piece");
            let data = ChunkData {
                density_hu: &values.density_hu,
                solid: &values.solid,
                class: &values.class,
                label: &values.label,
            };
            bone.push_chunk(piece.coord, piece.bony, &data)
                .expect("a chunk");
        }
        let mut cut = Cut::new(&bone);
        cut.reset(0);
        Self { bone, cut }
    }

    /// Takes over a message; a digest to answer, if it is one.
    fn take(&mut self, message: &ToViewer) -> Option<Digest> {
        match message {
            ToViewer::Reset { epoch } => self.cut.reset(*epoch),
            ToViewer::Undone { epoch, .. } => self.cut.set_epoch(*epoch),
            ToViewer::Bricks(bricks) => {
                let values = unpack_bricks(bricks).expect("bricks");
                for ((chunk, brick), v) in bricks.ids.iter().zip(values.chunks(512)) {
                    assert!(self.cut.set_brick(*chunk as usize, usize::from(*brick), v));
                }
            }
            ToViewer::Digest(digest) => return Some(*digest),
            _ => {}
        }
        None
    }

    fn digest(&mut self, asked: &Digest) -> Digest {
        self.cut.set_revision(asked.revision);
        let own = self.cut.digest(&self.bone);
        Digest {
            epoch: own.epoch,
            revision: own.revision,
            hash: own.hash,
            changed_chunks: own.changed_chunks,
        }
    }
}

#[test]
fn a_stalled_then_killed_viewer_costs_no_bit() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let out = dir.path().join("out.json").display().to_string();
    let args = [
        "demo",
        "--headless",
        "--seconds",
        "20",
        "--json",
        &out,
        "--disturb-viewer",
        "stop@4:5,kill@12",
    ];
    let output = run(OSTEON, &args, dir.path(), Duration::from_mins(2));
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let report = json(&dir.path().join("out.json"));
    assert!(number(&report, "/ticks") >= 15_000.0);
    assert!(number(&report, "/viewer/connected") >= 2.0);
    assert!(number(&report, "/viewer/lost") >= 1.0);
    assert!(number(&report, "/digest/changed_chunks") > 0.0);
    assert_eq!(report["digest"]["servo"], report["digest"]["publisher"]);
    assert_eq!(report["digest"]["servo"], report["digest"]["viewer"]);
}

/// Viewers that are none: each is answered by a closed door.
fn bad_company(dir: &Path) {
    let mut garbage = Client::connect(dir);
    (&garbage.stream).write_all(&[0x5a; 4096]).expect("sent");
    assert!(garbage.hear().is_none(), "garbage");
    let mut long = Client::connect(dir);
    let head = [u32::MAX.to_le_bytes(), [0; 4]].concat();
    (&long.stream).write_all(&head).expect("sent");
    assert!(long.hear().is_none(), "an absurd length");
    let mut rude = Client::connect(dir);
    rude.say(&FromViewer::Command(Command::Stop));
    assert!(rude.hear().is_none(), "a command before the hello");
    let mut old = Client::connect(dir);
    old.say(&FromViewer::Hello {
        version: IPC_VERSION + 7,
        name: "old".to_owned(),
    });
    let reason = old.until(|m| match m {
        ToViewer::Refused { reason } => Some(reason.clone()),
        _ => None,
    });
    let version = format!("version {}", IPC_VERSION + 7);
    assert!(reason.contains(&version), "{reason}");
    assert!(old.hear().is_none(), "another version");
    let mut silent = Client::connect(dir);
    assert!(silent.hear().is_none(), "silence");
}

/// The lines that the haptics process wrote about each of them: one, with its reason.
fn check_refusals(errors: &str) {
    for (viewer, reason, times) in [
        ("viewer 'viewer': ", "no message", 2),
        ("viewer 'viewer': ", "spoke before its hello", 1),
        ("viewer 'old': ", "update the older", 1),
        ("viewer 'viewer': ", "said nothing for 3 s", 1),
        ("viewer 'flood': ", "", 1),
    ] {
        let found = errors
            .lines()
            .filter(|l| l.contains(viewer) && l.contains(reason))
            .count();
        assert_eq!(found, times, "{viewer}{reason} in {errors}");
    }
    assert!(!errors.contains("panicked"), "{errors}");
}

/// Wishes without end from a viewer that never reads; the good one's wish comes through meanwhile.
fn flood(dir: &Path, good: &mut Client, mirror: &mut Mirror) {
    let mut flood = Client::hello(dir, "flood");
    for _ in 0..20_000 {
        flood.say(&FromViewer::Command(Command::Spindle(true)));
    }
    wish_for_tool(good, mirror, 1);
    drop(flood);
    until("the flood's end", LIMIT, || {
        text(dir, "haptics.err").contains("viewer 'flood'")
    });
}

/// Wishes for a tool until it is there: where all shout, a wish may be lost.
fn wish_for_tool(client: &mut Client, mirror: &mut Mirror, tool: u8) {
    let mut now = None;
    let end = Instant::now() + LIMIT;
    while now != Some(tool) {
        assert!(Instant::now() < end, "no tool {tool} within {LIMIT:?}");
        client.say(&FromViewer::Command(Command::SelectTool(tool)));
        now = Some(pose(client, mirror).tool);
    }
}

/// The next pose; the bone is kept up to date on the way.
fn pose(client: &mut Client, mirror: &mut Mirror) -> PoseUpdate {
    client.until(|m| {
        mirror.take(m);
        match m {
            ToViewer::Pose(pose) => Some(*pose),
            _ => None,
        }
    })
}

/// Ends the session as a viewer does: stop, compare, answer, goodbye.
fn stop(client: &mut Client, mirror: &mut Mirror) -> Digest {
    client.say(&FromViewer::Command(Command::Stop));
    let asked = client.until(|m| mirror.take(m));
    let digest = mirror.digest(&asked);
    assert_eq!(digest, asked, "the bone of a third party's viewer");
    client.say(&FromViewer::Digest {
        digest,
        frames_rendered: 7,
        updates: 0,
        resyncs: 1,
    });
    client.until(|m| matches!(m, ToViewer::Bye { .. }).then_some(()));
    digest
}

#[test]
fn bad_company_is_turned_away_and_a_good_viewer_is_served() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, Some(&stroke::peck(dir)));
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut good = Client::hello(dir, "good");
    let mut mirror = Mirror::receive(&mut good);
    let before = pose(&mut good, &mut mirror).tick;
    bad_company(dir);
    flood(dir, &mut good, &mut mirror);

    // a tool that is not there changes nothing, a reset gives the bone back
    good.say(&FromViewer::Command(Command::SelectTool(7)));
    good.until(|m| {
        mirror.take(m);
        matches!(m, ToViewer::Bricks(_)).then_some(())
    });
    good.say(&FromViewer::Command(Command::Reset));
    good.until(|m| {
        mirror.take(m);
        matches!(m, ToViewer::Reset { epoch: 1 }).then_some(())
    });
    good.say(&FromViewer::Command(Command::Checkpoint));
    pose_that(&mut good, &mut mirror, |p| p.checkpoints == 1);
    wish_for_tool(&mut good, &mut mirror, 0);
    let cut = pose_that(&mut good, &mut mirror, |p| p.removed_mm3 > 20.0);
    // back to the checkpoint, and a new cut from there
    good.say(&FromViewer::Command(Command::Undo));
    let left = good.until(|m| {
        mirror.take(m);
        match m {
            ToViewer::Undone {
                epoch: 2,
                removed_mm3_by_class,
            } => Some(removed_mm3_by_class.iter().sum::<f64>()),
            _ => None,
        }
    });
    assert!(left < cut.removed_mm3, "{left} of {}", cut.removed_mm3);
    let after = pose_that(&mut good, &mut mirror, |p| {
        p.checkpoints == 0 && p.removed_mm3 > left + 10.0
    });
    // the silent one alone took 3 s
    assert!(after.tick > before + 2000, "{before} to {}", after.tick);
    let digest = stop(&mut good, &mut mirror);
    assert!(digest.epoch == 2 && digest.changed_chunks > 0);
    assert!(haptics.wait(LIMIT).success());
    let report = json(&dir.join("report.json"));
    assert_eq!(report["digest"]["servo"], report["digest"]["viewer"]);
    assert!(number(&report, "/viewer/frames_rendered") >= 7.0);
    check_refusals(&text(dir, "haptics.err"));
}

#[test]
fn a_viewer_that_lies_about_its_bone_is_found_out() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut liar = Client::hello(dir, "liar");
    let _mirror = Mirror::receive(&mut liar);
    liar.say(&FromViewer::Command(Command::Stop));
    let mut asked = liar.until(|m| match m {
        ToViewer::Digest(digest) => Some(*digest),
        _ => None,
    });
    asked.hash ^= 1;
    liar.say(&FromViewer::Digest {
        digest: asked,
        frames_rendered: 0,
        updates: 0,
        resyncs: 1,
    });
    assert_eq!(haptics.wait(LIMIT).code(), Some(1));
    assert!(text(dir, "haptics.err").contains("digests differ"));
}

#[test]
fn the_haptics_process_maps_no_graphics_library() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let _device = fake(OSTEON, dir.path(), None);
    let mut haptics = haptics(OSTEON, dir.path(), &[]);
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", haptics.id())).expect("maps");
    assert!(maps.contains("libc"), "a control: the list is not empty");
    for library in [
        "libvulkan",
        "libX11",
        "libwayland",
        "libGL",
        "libEGL",
        "libxkbcommon",
    ] {
        assert!(!maps.contains(library), "{library}");
    }
    // and it lets nobody but its user in
    let modes = std::fs::metadata(socket(dir.path()).parent().expect("a folder")).expect("a mode");
    use std::os::unix::fs::PermissionsExt as _;
    assert_eq!(modes.permissions().mode() & 0o077, 0);
    haptics.signal(rustix::process::Signal::TERM);
    until("the end", LIMIT, || !haptics.runs());
}

/// The first pose that holds what is wanted.
fn pose_that(
    client: &mut Client,
    mirror: &mut Mirror,
    wanted: impl Fn(&PoseUpdate) -> bool,
) -> PoseUpdate {
    let end = Instant::now() + LIMIT;
    loop {
        let now = pose(client, mirror);
        if wanted(&now) {
            return now;
        }
        assert!(Instant::now() < end, "{now:?} after {LIMIT:?}");
    }
}

/// Whether a message says that this viewer is in control.
fn in_control(message: &ToViewer, number: u16) -> Option<()> {
    match message {
        ToViewer::Control(state) if state.holder == Some(number) => Some(()),
        _ => None,
    }
}

#[test]
fn a_clutch_is_let_go_for_a_viewer_that_has_gone() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut good = Client::hello(dir, "good");
    let mut mirror = Mirror::receive(&mut good);
    let before = pose(&mut good, &mut mirror);
    assert!(!before.clutched && (before.motion_scale - 1.0).abs() < 1e-6);
    let mut holder = Client::hello(dir, "holder");
    let holder_number = holder.until(|m| match m {
        ToViewer::Welcome(welcome) => Some(welcome.number),
        _ => None,
    });
    // a wish of one that is not in control is refused aloud, and changes nothing
    holder.say(&FromViewer::Command(Command::Clutch(true)));
    holder.until(|m| matches!(m, ToViewer::Denied { .. }).then_some(()));
    assert!(!pose(&mut good, &mut mirror).clutched);
    good.say(&FromViewer::Command(Command::HandOver(holder_number)));
    holder.until(|m| in_control(m, holder_number));
    holder.say(&FromViewer::Command(Command::Clutch(true)));
    pose_that(&mut good, &mut mirror, |p| p.clutched);
    drop(holder);
    pose_that(&mut good, &mut mirror, |p| !p.clutched);
    good.say(&FromViewer::Command(Command::AskControl));
    good.until(|m| {
        mirror.take(m);
        in_control(m, 1)
    });
    // a scale is taken over; one out of its range ends the connection and changes nothing
    good.say(&FromViewer::Command(Command::MotionScale(500)));
    good.say(&FromViewer::Command(Command::TurnWorkspace(-262)));
    pose_that(&mut good, &mut mirror, |p| {
        (p.motion_scale - 0.5).abs() < 1e-6
    });
    let mut wrong = Client::hello(dir, "wrong");
    wrong.say(&FromViewer::Command(Command::MotionScale(100)));
    while wrong.hear().is_some() {}
    let after = pose(&mut good, &mut mirror);
    assert!((after.motion_scale - 0.5).abs() < 1e-6);
    let guards = good.until(|m| {
        mirror.take(m);
        match m {
            ToViewer::Health(health) => Some(health.guards.len()),
            _ => None,
        }
    });
    stop(&mut good, &mut mirror);
    assert!(haptics.wait(LIMIT).success());
    let report = json(&dir.join("report.json"));
    assert_eq!(
        report["guards"].as_object().map(serde_json::Map::len),
        Some(guards)
    );
    assert!(number(&report, "/clutched_ticks") > 0.0);
    assert!(text(dir, "haptics.err").contains("viewer 'wrong'"));
}
