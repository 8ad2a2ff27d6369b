//! What a viewer does never reaches the servo: stalls, deaths, silence, garbage, floods.
#![expect(
    clippy::expect_used,
    clippy::items_after_statements,
    clippy::panic,
    clippy::too_many_lines,
    reason = "what goes wrong here is a failed test"
)]

use interprocess::local_socket::traits::Stream as _;
use interprocess::local_socket::{GenericFilePath, Stream, ToFsName as _};
use osteon_protocol::ipc::{Command, Digest, FromViewer, IPC_VERSION, Scene, ToViewer};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into, unpack_bricks, unpack_piece};
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_tests::{fake, haptics, json, number, one_at_a_time, run, socket, text, until};
use std::io::{Read as _, Write as _};
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
        Self {
            stream: Stream::connect(name).expect("a connection"),
            decoder: StreamDecoder::new(),
        }
    }

    fn hello(dir: &Path) -> Self {
        let mut client = Self::connect(dir);
        client.say(&FromViewer::Hello {
            version: IPC_VERSION,
            name: "test".to_owned(),
        });
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
                Ok(0) | Err(_) => return None,
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

#[test]
fn bad_company_is_turned_away_and_a_good_viewer_is_served() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut good = Client::hello(dir);
    let mut mirror = Mirror::receive(&mut good);

    let mut garbage = Client::connect(dir);
    (&garbage.stream).write_all(&[0x5a; 4096]).expect("sent");
    assert!(
        garbage.hear().is_none(),
        "garbage is answered by a closed door"
    );
    let mut long = Client::connect(dir);
    (&long.stream)
        .write_all(&u32::MAX.to_le_bytes())
        .expect("sent");
    (&long.stream).write_all(&[0; 64]).expect("sent");
    assert!(long.hear().is_none(), "an absurd length ends it");
    let mut old = Client::connect(dir);
    old.say(&FromViewer::Hello {
        version: IPC_VERSION + 7,
        name: "old".to_owned(),
    });
    let reason = old.until(|m| match m {
        ToViewer::Refused { reason } => Some(reason.clone()),
        _ => None,
    });
    assert!(reason.contains("version 8"), "{reason}");
    let mut silent = Client::connect(dir);
    let begun = Instant::now();
    assert!(silent.hear().is_none());
    assert!(begun.elapsed() < Duration::from_secs(10));

    // a flood of wishes from a viewer that never reads
    let mut flood = Client::hello(dir);
    for n in 0..20_000u32 {
        flood.say(&FromViewer::Command(Command::Spindle(n % 2 == 0)));
    }
    good.say(&FromViewer::Command(Command::SelectTool(1)));
    good.until(|m| match m {
        ToViewer::Pose(pose) if pose.tool == 1 => Some(()),
        _ => None,
    });
    good.say(&FromViewer::Command(Command::SelectTool(7)));
    good.say(&FromViewer::Command(Command::Reset));
    good.until(|m| {
        mirror.take(m);
        matches!(m, ToViewer::Reset { epoch: 1 }).then_some(())
    });
    drop(flood);
    good.say(&FromViewer::Command(Command::Stop));
    let asked = good.until(|m| mirror.take(m));
    let digest = mirror.digest(&asked);
    assert_eq!(digest, asked);
    good.say(&FromViewer::Digest {
        digest,
        frames_rendered: 7,
        updates: 0,
        resyncs: 1,
    });
    good.until(|m| matches!(m, ToViewer::Bye { .. }).then_some(()));
    assert!(haptics.wait(LIMIT).success());
    let report = json(&dir.join("report.json"));
    assert_eq!(report["digest"]["epoch"], 1);
    assert!(number(&report, "/viewer/frames_rendered") >= 7.0);
    let errors = text(dir, "haptics.err");
    for (line, word) in [
        ("viewer 'viewer': ", "no message"),
        ("viewer 'old': ", "version"),
    ] {
        assert!(
            errors.lines().any(|l| l.contains(line) && l.contains(word)),
            "{line}{word} in {errors}"
        );
    }
    assert!(errors.contains("said nothing for 3 s"), "{errors}");
}

#[test]
fn a_viewer_that_lies_about_its_bone_is_found_out() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut liar = Client::hello(dir);
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
