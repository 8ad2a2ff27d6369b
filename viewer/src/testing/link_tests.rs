//! The whole way without a window: socket, mirror, pictures, answers, exits.

use super::bones::{scapula_like, surgery};
use super::messages::{brick_updates, pose_at, upload, wire};
use super::server::{Server, Talk};
use crate::adapter;
use crate::cli::ViewArgs;
use crate::link::{Joining, Link, Place, Shared};
use glam::DVec3;
use osteon_protocol::ipc::{
    Command, Digest, FromViewer, IPC_VERSION, Role, ToViewer, Welcome, capability,
};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::pose::Pose;
use std::path::{Path, PathBuf};
use std::time::Duration;

fn args(socket: &Path, out: Option<PathBuf>) -> ViewArgs {
    ViewArgs {
        mirror_only: false,
        socket: socket.to_owned(),
        connect: None,
        peer: None,
        keys: None,
        remote: None,
        role: Role::Trainee,
        report: out.as_ref().map(|o| o.with_extension("json")),
        offscreen: out,
        size: [320, 180],
        scale: None,
        renderer: None,
        seconds: None,
        avoid_core: None,
        die_with_parent: false,
        window_screenshot: None,
        screenshot_after: 1.0,
    }
}

#[test]
fn a_whole_session_offscreen_ends_with_a_picture_equal_digests_and_a_report() {
    if let Err(e) = adapter::open() {
        eprintln!("SKIPPED whole session: {e:#}");
        return;
    }
    let (bone, plan) = scapula_like(1.0);
    let server = Server::start(
        "whole",
        Box::new(move |talk| {
            let mut cut = Cut::new(&bone);
            talk.hello();
            assert!(matches!(
                talk.hear(),
                FromViewer::Hello {
                    version: IPC_VERSION,
                    ..
                }
            ));
            assert!(matches!(talk.hear(), FromViewer::Join(_)));
            for message in upload(&bone, &plan) {
                talk.send(&message);
            }
            surgery(&bone, &mut cut, &plan);
            for (tick, update) in (1u64..).zip(brick_updates(&bone, &cut)) {
                let mut pose = pose_at([0.0; 3]);
                pose.tick = tick * 100;
                pose.bone_from_tool = wire(&Pose::new(plan.rotation, plan.point(DVec3::Z * 12.0)));
                talk.send(&ToViewer::Pose(pose));
                talk.send(&ToViewer::Bricks(update));
                std::thread::sleep(Duration::from_millis(30));
            }
            let own = cut.digest(&bone);
            let own = Digest {
                epoch: own.epoch,
                revision: own.revision,
                hash: own.hash,
                changed_chunks: own.changed_chunks,
            };
            assert_eq!(talk.digest(own), own);
            talk.bye();
        }),
    );
    let out = server.socket.with_file_name("out.png");
    crate::run_here(args(&server.socket, Some(out.clone()))).unwrap();
    let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(&out).unwrap()));
    let reader = decoder.read_info().unwrap();
    assert_eq!((reader.info().width, reader.info().height), (320, 180));
    let text = std::fs::read_to_string(out.with_extension("json")).unwrap();
    eprintln!("{text}");
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert!(report["frames"].as_u64().is_some_and(|n| n > 1), "{text}");
    assert!(report["updates"].as_u64().is_some_and(|n| n > 0), "{text}");
    assert_eq!(
        (report["resyncs"].as_u64(), report["end"].as_str()),
        (Some(1), Some("bye: done"))
    );
    server.join();
}

fn start(socket: &Path, shared: &std::sync::Arc<Shared>) -> Result<Link, String> {
    let joining = Joining {
        name: "test".to_owned(),
        role: Role::Trainee,
        control: true,
        pose_hz: 60,
    };
    let place = Place::Socket(socket.to_owned());
    Link::start(&place, &joining, shared).map_err(|e| e.to_string())
}

/// Runs a viewer against a script and returns its error line.
fn error_of(name: &str, script: impl FnOnce(&mut Talk) + Send + 'static) -> String {
    let server = Server::start(name, Box::new(script));
    let shared = Shared::new();
    let link = start(&server.socket, &shared).unwrap();
    shared.wait(Duration::from_secs(20), |m| m.end.is_some());
    let end = shared.mirror().end.clone();
    link.flush(Duration::from_millis(100));
    server.join();
    match end {
        Some(crate::mirror::End::Failed(line)) => line,
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn what_is_no_session_is_refused_in_one_line() {
    let cases: [(&str, Box<dyn FnOnce(&mut Talk) + Send>, &str); 6] = [
        (
            "garbage",
            Box::new(|t| t.send_bytes(&[0x5a; 4096])),
            "no osteon messages",
        ),
        (
            "http",
            Box::new(|t| t.send_bytes(b"HTTP/1.1 400 Bad Request\r\n\r\n")),
            "no osteon messages",
        ),
        (
            "version",
            Box::new(|t| t.send(&ToViewer::Hello { version: 999 })),
            "version 999",
        ),
        (
            "refused",
            Box::new(|t| {
                t.hello();
                t.send(&ToViewer::Refused {
                    reason: "one viewer is enough; close the other".into(),
                });
            }),
            "one viewer is enough",
        ),
        ("silent", Box::new(Talk::hello), "without a farewell"),
        (
            "rude",
            Box::new(|t| t.send(&ToViewer::Reset { epoch: 1 })),
            "did not begin with a hello",
        ),
    ];
    for (name, script, expected) in cases {
        let line = error_of(name, script);
        assert!(
            line.contains(expected) && !line.contains('\n'),
            "{name}: {line}"
        );
        eprintln!("{line}");
    }
}

#[test]
fn an_absent_socket_is_named_with_the_remedy() {
    let shared = Shared::new();
    let path = Path::new("/nonexistent/osteon.sock");
    let line = start(path, &shared).err().unwrap_or_default();
    assert!(
        line.contains("/nonexistent/osteon.sock") && line.contains("--socket"),
        "{line}"
    );
}

/// Sends commands and sees them arrive, in order.
pub(crate) fn arrive(commands: &[Command]) {
    let wanted = commands.to_vec();
    let server = Server::start(
        "every-command",
        Box::new(move |talk| {
            talk.hello();
            assert!(matches!(talk.hear(), FromViewer::Hello { .. }));
            assert!(matches!(talk.hear(), FromViewer::Join(_)));
            for command in wanted {
                assert_eq!(talk.hear(), FromViewer::Command(command));
            }
            talk.bye();
        }),
    );
    let shared = Shared::new();
    let link = start(&server.socket, &shared).unwrap();
    assert!(commands.iter().all(|&c| link.command(c)));
    shared.wait(Duration::from_secs(10), |m| m.end.is_some());
    assert!(matches!(
        shared.mirror().end,
        Some(crate::mirror::End::Bye(_))
    ));
    server.join();
}

#[test]
fn commands_arrive_in_order_and_a_stuck_link_does_not_hold_the_caller() {
    let (release, wait) = std::sync::mpsc::sync_channel::<()>(1);
    let server = Server::start(
        "commands",
        Box::new(move |talk| {
            talk.hello();
            assert!(matches!(talk.hear(), FromViewer::Hello { .. }));
            assert!(matches!(talk.hear(), FromViewer::Join(_)));
            assert_eq!(talk.hear(), FromViewer::Command(Command::SelectTool(1)));
            assert_eq!(talk.hear(), FromViewer::Command(Command::Spindle(true)));
            wait.recv().unwrap();
            talk.bye();
        }),
    );
    let shared = Shared::new();
    let link = start(&server.socket, &shared).unwrap();
    assert!(link.command(Command::SelectTool(1)));
    assert!(link.command(Command::Spindle(true)));
    // nobody reads now: socket and channel fill up, and the caller is told at once
    let begin = std::time::Instant::now();
    let refused = (0..200_000).any(|_| !link.command(Command::Pause(true)));
    assert!(refused && begin.elapsed() < Duration::from_secs(5));
    release.send(()).unwrap();
    shared.wait(Duration::from_secs(10), |m| m.end.is_some());
    assert!(matches!(
        shared.mirror().end,
        Some(crate::mirror::End::Bye(_))
    ));
    server.join();
}

#[test]
fn a_broken_connection_is_made_again_and_goes_on_where_it_was() {
    let (bone, plan) = scapula_like(2.0);
    let messages = upload(&bone, &plan);
    let welcome = Welcome {
        session: 7,
        seat: 8,
        number: 1,
        granted: capability::ALL,
        resumed: false,
    };
    let server = Server::start_for(
        "again",
        2,
        Box::new(move |talk| {
            talk.hello();
            assert!(matches!(talk.hear(), FromViewer::Hello { .. }));
            let FromViewer::Join(join) = talk.hear() else {
                panic!("no join");
            };
            let Some(resume) = join.resume else {
                talk.send(&ToViewer::Welcome(welcome));
                for message in &messages[..3] {
                    talk.send(message);
                }
                // gone without a farewell
                return;
            };
            // the scene and two pieces had come
            assert_eq!((resume.session, resume.seat), (7, 8));
            assert_eq!((resume.pieces, resume.batches, resume.epoch), (2, 0, 0));
            talk.send(&ToViewer::Welcome(Welcome {
                resumed: true,
                ..welcome
            }));
            for message in &messages[3..] {
                talk.send(message);
            }
            talk.bye();
        }),
    );
    let shared = Shared::new();
    let link = start(&server.socket, &shared).unwrap();
    shared.wait(Duration::from_secs(20), |m| m.end.is_some());
    let (here, all) = shared.mirror().chunks();
    assert!(here == all && all > 3, "{here} of {all}");
    assert!(matches!(
        shared.mirror().end,
        Some(crate::mirror::End::Bye(_))
    ));
    assert_eq!(shared.mirror().resyncs, 1, "it never began anew");
    link.flush(Duration::from_millis(100));
    server.join();
}
