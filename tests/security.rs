//! A test for each line of SECURITY.md's table that is about the running programs; the others are
//! beside the code and named there.
#![expect(clippy::expect_used, reason = "what goes wrong here is a failed test")]

use osteon_protocol::secure::{ANSWER_BYTES, Call, Identity, PublicKey};
use osteon_tests::{
    Running, fake, haptics, json, number, one_at_a_time, refused, run, skipped, socket, stroke,
    text, until, workspace,
};
use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::process::Command;
use std::time::{Duration, Instant};

const OSTEON: &str = env!("CARGO_BIN_EXE_osteon");
const LIMIT: Duration = Duration::from_secs(30);

/// Runs `osteon key` with the keys of `who`; what it printed.
fn key(dir: &Path, who: &str, task: &[&str]) -> String {
    let keys = dir.join(who).display().to_string();
    let args = [&["key"], task, &["--keys", &keys]].concat();
    let output = run(OSTEON, &args, dir, LIMIT);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

/// A session that listens at a port of this machine for the viewer whose keys lie in `DIR/viewer`.
struct Remote {
    _device: Running,
    haptics: Running,
    address: String,
    key: PublicKey,
}

fn remote(dir: &Path, more: &[&str]) -> Remote {
    let (ours, theirs) = (key(dir, "haptics", &["new"]), key(dir, "viewer", &["new"]));
    key(dir, "haptics", &["trust", "viewer", &theirs]);
    key(dir, "viewer", &["trust", "lab", &ours]);
    let device = fake(OSTEON, dir, Some(&stroke::peck(dir)));
    let keys = dir.join("haptics-keys");
    std::fs::rename(dir.join("haptics"), &keys).expect("moved");
    let keys = keys.display().to_string();
    let mut args = vec!["--listen", "127.0.0.1:0", "--keys", &keys];
    args.extend(more);
    let haptics = haptics(OSTEON, dir, &args);
    let said = text(dir, "haptics.out");
    let address = said.lines().find_map(|l| l.split_once("can connect to "));
    Remote {
        _device: device,
        haptics,
        address: address.expect("an address").1.to_owned(),
        key: PublicKey::from_hex(&ours).expect("a key"),
    }
}

#[test]
fn a_trusted_viewer_on_the_network_mirrors_the_bone_and_nothing_is_readable_on_the_way() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let mut remote = remote(dir, &["--seconds", "7"]);
    let (tap, heard) = wiretap(&remote.address);
    let keys = dir.join("viewer").display().to_string();
    let args = ["view", "--mirror-only", "--connect", &tap, "--keys", &keys];
    let output = run(OSTEON, &args, dir, LIMIT);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(
        remote.haptics.wait(LIMIT).success(),
        "{}",
        text(dir, "haptics.err")
    );
    let report = json(&dir.join("report.json"));
    assert_eq!(report["digest"]["viewer"], report["digest"]["servo"]);
    assert!(number(&report, "/digest/changed_chunks") > 0.0);
    let heard = heard.join().expect("the tap");
    assert!(heard.len() > 100_000, "{} bytes", heard.len());
    for word in [&b"phantom"[..], b"mirror only", b"glenoid"] {
        let found = heard.windows(word.len()).any(|w| w == word);
        assert!(!found, "{}", String::from_utf8_lossy(word));
    }
}

/// Somebody on the way who passes everything on and keeps it: its address, and what it heard.
fn wiretap(to: &str) -> (String, std::thread::JoinHandle<Vec<u8>>) {
    let listener = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = listener.local_addr().expect("an address").to_string();
    let to = to.to_owned();
    let thread = std::thread::Builder::new()
        .name("tap".into())
        .spawn(move || {
            let (viewer, _) = listener.accept().expect("a viewer");
            let haptics = TcpStream::connect(to).expect("the haptics process");
            let copy = |from: &TcpStream, into: &TcpStream| {
                let (mut from, mut into) = (
                    from.try_clone().expect("a handle"),
                    into.try_clone().expect("a handle"),
                );
                std::thread::Builder::new()
                    .name("tap".into())
                    .spawn(move || {
                        let (mut all, mut buffer) = (Vec::new(), vec![0; 65_536]);
                        while let Ok(n @ 1..) = from.read(&mut buffer) {
                            all.extend_from_slice(&buffer[..n]);
                            if into.write_all(&buffer[..n]).is_err() {
                                break;
                            }
                        }
                        into.shutdown(std::net::Shutdown::Both).unwrap_or(());
                        all
                    })
                    .expect("a thread")
            };
            let (up, down) = (copy(&viewer, &haptics), copy(&haptics, &viewer));
            let mut all = up.join().expect("up");
            all.extend(down.join().expect("down"));
            all
        });
    (address, thread.expect("a thread"))
}

/// What the other side says to `bytes`, until it hangs up.
fn said_to(address: &str, bytes: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(address).expect("a connection");
    stream.set_read_timeout(Some(LIMIT)).expect("a limit");
    stream.write_all(bytes).expect("sent");
    let mut said = Vec::new();
    // a reset is an end as well
    stream.read_to_end(&mut said).unwrap_or(0);
    said
}

/// An overheard call, played back: answered, and the record that followed does not open.
fn played_back(dir: &Path, address: &str, key: PublicKey) {
    let viewer = std::fs::read_to_string(dir.join("viewer/identity")).expect("a key");
    let viewer = Identity::from_secret_hex(viewer.trim()).expect("a key");
    let (call, bytes) = Call::begin(&viewer, key).expect("a call");
    let mut first = TcpStream::connect(address).expect("a connection");
    first.write_all(&bytes).expect("sent");
    let mut answer = [0; ANSWER_BYTES];
    first.read_exact(&mut answer).expect("an answer");
    let (mut sealer, _) = call.end(&answer).expect("a handshake");
    let mut overheard = bytes.to_vec();
    sealer.seal(b"stop", &mut overheard).expect("a record");
    drop(first);
    assert_eq!(said_to(address, &overheard).len(), ANSWER_BYTES);
}

#[test]
fn nobody_else_gets_past_the_handshake_and_the_session_goes_on() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let mut remote = remote(dir, &[]);
    let address = remote.address.clone();
    // noise, another protocol, somebody without a trusted key: not a byte comes back
    assert!(said_to(&address, &[0x5a; 400]).is_empty());
    assert!(said_to(&address, format!("GET / HTTP/1.1\r\n{:90}", "").as_bytes()).is_empty());
    let stranger = Identity::generate().expect("a key");
    let (_, call) = Call::begin(&stranger, remote.key).expect("a call");
    assert!(said_to(&address, &call).is_empty());
    // a half call: cut off after two seconds
    let began = Instant::now();
    assert!(said_to(&address, &call[..50]).is_empty());
    assert!(began.elapsed() < Duration::from_secs(6));
    played_back(dir, &address, remote.key);
    // a flood of callers that say nothing, and the one with the key gets in beside them
    let mut flood: Vec<TcpStream> = (0..100)
        .filter_map(|_| TcpStream::connect(&address).ok())
        .collect();
    let keys = dir.join("viewer").display().to_string();
    let args = [
        "view",
        "--mirror-only",
        "--connect",
        &address,
        "--keys",
        &keys,
        "--seconds",
        "2",
    ];
    let output = run(OSTEON, &args, dir, LIMIT);
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    flood.clear();
    remote.haptics.signal(rustix::process::Signal::TERM);
    assert!(
        remote.haptics.wait(LIMIT).success(),
        "{}",
        text(dir, "haptics.err")
    );
    let errors = text(dir, "haptics.err");
    for reason in [
        "does not open with the keys",
        "not trusted",
        "handshake in 2 s",
        "not authentic",
    ] {
        assert!(errors.contains(reason), "{reason}: {errors}");
    }
    assert!(
        errors.lines().count() < 80,
        "a flood fills no disk: {errors}"
    );
    let report = json(&dir.join("report.json"));
    assert_eq!(report["viewer"]["connected"], 1);
    assert!(number(&report, "/viewer/refused") >= 84.0);
}

#[test]
fn the_wrong_key_and_missing_keys_are_refused_with_the_remedy() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let remote = remote(dir, &[]);
    // a viewer that expects somebody else: it must not talk to this one
    let other = key(dir, "other", &["new"]);
    let keys = dir.join("other").display().to_string();
    key(dir, "other", &["trust", "lab", &other]);
    let wrong = [
        "view",
        "--mirror-only",
        "--connect",
        &remote.address,
        "--keys",
        &keys,
    ];
    refused(OSTEON, dir, &wrong, &["trust each other's key"]);
    // keys that others can read are not used
    let identity = dir.join("other/identity");
    let open = std::fs::Permissions::from_mode(0o644);
    std::fs::set_permissions(identity, open).expect("a mode");
    refused(OSTEON, dir, &wrong, &["chmod 600"]);
    let none = dir.join("none").display().to_string();
    let without = [
        "view",
        "--mirror-only",
        "--connect",
        "127.0.0.1:9",
        "--keys",
        &none,
    ];
    refused(OSTEON, dir, &without, &["osteon key new"]);
    // without --listen there is no port: none of this process's sockets is one
    let ports = std::fs::read_to_string("/proc/net/tcp").expect("a list");
    assert!(ports.contains(&port_hex(&remote.address)), "a control");
}

fn port_hex(address: &str) -> String {
    let port: u16 = address
        .rsplit_once(':')
        .and_then(|(_, p)| p.parse().ok())
        .expect("a port");
    format!(":{port:04X} ")
}

#[test]
fn without_listen_nothing_listens_on_the_network_and_other_users_are_turned_away() {
    let _turn = one_at_a_time();
    let dir = tempfile::tempdir().expect("a folder");
    let dir = dir.path();
    let _device = fake(OSTEON, dir, None);
    let mut haptics = haptics(OSTEON, dir, &[]);
    let mut inodes = Vec::new();
    for fd in std::fs::read_dir(format!("/proc/{}/fd", haptics.id())).expect("handles") {
        let target = std::fs::read_link(fd.expect("a handle").path()).unwrap_or_default();
        inodes.extend(
            target
                .display()
                .to_string()
                .strip_prefix("socket:[")
                .map(|i| i.trim_end_matches(']').to_owned()),
        );
    }
    assert!(!inodes.is_empty(), "a control: the viewers' socket");
    for table in ["tcp", "tcp6", "udp", "udp6"] {
        let list = std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
        for inode in &inodes {
            assert!(!list.split_whitespace().any(|w| w == inode), "{table}");
        }
    }
    as_another_user(dir);
    haptics.signal(rustix::process::Signal::TERM);
    until("the end", LIMIT, || !haptics.runs());
}

/// Another user who reaches the socket all the same (its folder was opened by mistake) is seen by its
/// credentials. Needs the right to be another user.
fn as_another_user(dir: &Path) {
    if !rustix::process::geteuid().is_root() {
        skipped("another user at the socket: only root can be somebody else");
        return;
    }
    let path = socket(dir);
    let open = |path: &Path, mode| {
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(mode)).expect("a mode");
    };
    for folder in [dir, path.parent().expect("a folder")] {
        open(folder, 0o755);
    }
    open(&path, 0o777);
    let code = "import os,socket,sys\nos.setuid(65534)\ns=socket.socket(socket.AF_UNIX)\ns.settimeout(5)\ns.connect(sys.argv[1])\nsys.exit(0 if s.recv(1)==b'' else 3)";
    let status = Command::new("python3")
        .args(["-c", code])
        .arg(&path)
        .status();
    match status {
        Ok(status) => assert!(status.success(), "{status}"),
        Err(e) => skipped(&format!("another user at the socket: python3 ({e})")),
    }
    until("the refusal", LIMIT, || {
        text(dir, "haptics.err").contains("65534")
    });
    // and one of ours is served meanwhile
    assert!(UnixStream::connect(&path).is_ok());
}

#[test]
fn the_table_names_tests_that_exist() {
    let table = std::fs::read_to_string(workspace().join("SECURITY.md")).expect("the table");
    let mut names = Vec::new();
    for line in table.lines().filter(|l| l.starts_with('|')) {
        names.extend(
            line.split('`')
                .skip(1)
                .step_by(2)
                .filter(|w| w.contains("::"))
                .map(str::to_owned),
        );
    }
    assert!(names.len() >= 12, "{names:?}");
    for name in names {
        let (file, test) = name.split_once("::").expect("FILE::TEST");
        let source = std::fs::read_to_string(workspace().join(file))
            .unwrap_or_else(|e| panic!("{file}: {e}"));
        assert!(source.contains(&format!("fn {test}(")), "{name}");
    }
}
