//! One session from the first option to the last digest.
use super::notes::Notes;
use super::opening::Session;
use super::outset::Outset;
use super::publisher::{Publisher, warn, wire_digest};
use super::reconnect::{self, Comings, Left};
use super::report::{Facts, SessionReport};
use super::resync::Resync;
use super::servo_loop::{self, Ending, Finished, Master, ServoThread};
use super::viewers::ViewerReport;
use super::{HapticsArgs, default_socket, socket};
use crate::clinic::guide::Guide;
use crate::feel;
use crate::link::{self, DeviceLink, DeviceSpec};
use crate::progress::Progress;
use crate::recording::{Begun, Blank, RING_TICKS, Recorder, Tap, describe};
use crate::rt::{self, RtReport};
use crate::scene;
use crate::stop;
use crate::tools::{self, Detail, LoadedTools};
use anyhow::{Context as _, anyhow, bail};
use osteon_protocol::ipc::Digest;
use osteon_protocol::ipc_frame::clip;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use std::fs::File;
use std::io::{BufWriter, Write as _};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time between two visits of the publisher.
const VISIT: Duration = Duration::from_millis(4);
/// Longest wait for a viewer's last digest.
const DIGEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A running servo thread.
struct Running {
    thread: JoinHandle<Finished>,
    stop: Arc<AtomicBool>,
    refused: Vec<String>,
    began: Instant,
}

impl Running {
    /// Stops it.
    fn end(self) -> anyhow::Result<Finished> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().map_err(|payload| {
            let message = servo_loop::panic_message(payload.as_ref());
            anyhow!("the servo thread died ({message}); the device's watchdog stops the motors")
        })
    }
}

/// How a session ended.
struct Outcome {
    finished: Finished,
    /// Somebody asked for the end, or its time was over.
    asked: bool,
    seconds: f64,
    refused: Vec<String>,
    comings: Comings,
}

pub(crate) fn run(args: &HapticsArgs) -> anyhow::Result<()> {
    if args.die_with_parent {
        rt::die_with_parent().context("cannot ask to end with the parent process")?;
    }
    Guide::check(args.task, args.scene.scene.as_deref())?;
    let stop = stop::on_signals()?;
    let feel = feel::load(&args.feel)?;
    let LoadedTools { tools, notes } = tools::load(&args.tools, Detail::Full)?;
    for note in notes {
        warn(&note);
    }
    let mut progress = Progress::new("loading bone");
    let scene = scene::load(&args.scene, &mut |stage, share| progress.show(stage, share))?;
    progress.finish();
    for note in small_tools(scene.bone.grid(), &tools) {
        warn(&note);
    }
    let socket_path = args.socket.clone().unwrap_or_else(default_socket);
    let listener = socket::listen(&socket_path)?;
    let result = with_listener(
        args,
        &stop,
        &Session {
            tools: &tools,
            scene: &scene,
            feel: &feel,
        },
        listener,
    );
    // the listener takes its socket away itself; one that is left over is replaced by the next session
    if let Err(e) = std::fs::remove_file(&socket_path)
        && e.kind() != std::io::ErrorKind::NotFound
    {
        warn(&format!("socket {}: {e}", socket_path.display()));
    }
    result
}

/// A line for each tool so thin that voxels cannot show its shape: its cut has the right place and a rough
/// size.
pub fn small_tools(grid: &Grid, tools: &[Tool]) -> Vec<String> {
    let h = grid.spacing_mm.max_element();
    let small = |tool: &&Tool| tool.shape.bounds().reach_mm() < h;
    let line = |tool: &Tool| {
        let radius = tool.shape.bounds().reach_mm();
        format!(
            "tool '{}': its radius of {radius:.3} mm is below a voxel of {h} mm, so its cuts are rough; use a smaller --voxel-mm",
            tool.id
        )
    };
    tools.iter().filter(small).map(line).collect()
}

fn with_listener(
    args: &HapticsArgs,
    stop: &Arc<AtomicBool>,
    session: &Session<'_>,
    listener: interprocess::local_socket::Listener,
) -> anyhow::Result<()> {
    let &Session { tools, scene, .. } = session;
    let outset = Outset::new(args, scene)?;
    let blank = args.record.as_deref().map(Blank::new).transpose()?;
    if stop.load(Ordering::Relaxed) {
        bail!("asked to end before the session began");
    }
    let spec = device_spec(args)?;
    let mut link = link::open(&spec)?;
    let link_name = clip(&link.describe()).to_owned();
    let servo = make_servo(args, session, link.as_ref())?;
    let (mut publisher, rings) = outset.publisher(session, listener, args.force_limit, &link_name);
    let resync = Resync::new(&scene.bone, tools.to_vec());
    let master = reconnect::master(args.clock, link.as_ref())?;
    let comings = Comings::new(args, spec, link.as_ref());
    let (recorder, recording) = recorder(args, session, link.as_ref(), blank)?.unzip();
    link.prepare()?;
    link.start()?;
    let thread = ServoThread {
        resync,
        servo,
        link,
        records: rings.records,
        requests: rings.requests,
        recording,
        panic_at_tick: args.panic_at_tick,
    };
    let running = start(thread, (master, 0), !args.no_realtime)?;
    running.refused.iter().for_each(|line| warn(line));
    say(&format!(
        "haptics: {} on {link_name}, 1 kHz; {} chunks of bone",
        scene.source,
        scene.bone.chunk_count()
    ));
    let outcome = go_on(
        args,
        stop,
        (&mut publisher, recorder.as_ref()),
        (running, master, comings),
    )?;
    finish(args, session, (publisher, recorder), &outcome)
}

/// Until somebody wants the end, or the device has gone for good.
fn go_on(
    args: &HapticsArgs,
    stop: &AtomicBool,
    (publisher, recorder): (&mut Publisher, Option<&Recorder>),
    (mut running, master, mut comings): (Running, Master, Comings),
) -> anyhow::Result<Outcome> {
    let (began, refused) = (running.began, running.refused.clone());
    let over = || {
        let long = |s| began.elapsed().as_secs_f64() >= s;
        stop.load(Ordering::Relaxed) || args.seconds.is_some_and(long)
    };
    let (finished, asked) = loop {
        let asked = serve_until_end(&over, (publisher, recorder), &running);
        let finished = running.end()?;
        if asked {
            break (finished, true);
        }
        match comings.wait(finished, publisher, &over)? {
            Left::Over(finished, asked) => break (*finished, asked),
            Left::Back(thread, tick) => {
                running = start(*thread, (master, tick), !args.no_realtime)?;
            }
        }
    };
    Ok(Outcome {
        finished,
        asked,
        seconds: began.elapsed().as_secs_f64(),
        refused,
        comings,
    })
}

/// Starts the recorder that was asked for, and gives the servo's end of its ring.
fn recorder(
    args: &HapticsArgs,
    session: &Session<'_>,
    link: &dyn DeviceLink,
    blank: Option<Blank>,
) -> anyhow::Result<Option<(Recorder, Tap)>> {
    let Some(blank) = blank else {
        return Ok(None);
    };
    let setup = describe(&Begun {
        scene_args: &args.scene,
        tool_args: &args.tools,
        scene: session.scene,
        servo: &servo_setup(args, session, link),
        device: link.info(),
        link_name: clip(&link.describe()),
    })?;
    let (ticks_in, ticks_out) = rtrb::RingBuffer::new(RING_TICKS);
    let recorder = Recorder::start(blank, setup, ticks_out)?;
    Ok(Some((recorder, Tap::new(ticks_in))))
}

fn device_spec(args: &HapticsArgs) -> anyhow::Result<DeviceSpec> {
    (args.device.parse()).map_err(|e| anyhow!("--device {e}"))
}

pub(super) fn create(path: &Path) -> anyhow::Result<File> {
    File::create(path).with_context(|| format!("{}: cannot write", path.display()))
}

fn make_servo(
    args: &HapticsArgs,
    session: &Session<'_>,
    link: &dyn DeviceLink,
) -> anyhow::Result<Servo> {
    Servo::new(servo_setup(args, session, link)).ok_or_else(|| anyhow!("no tools, or too many"))
}

fn servo_setup(args: &HapticsArgs, session: &Session<'_>, link: &dyn DeviceLink) -> ServoSetup {
    let &Session { tools, scene, feel } = session;
    ServoSetup {
        bone: Arc::clone(&scene.bone),
        tools: tools.to_vec(),
        bone_from_base: bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
        bone_from_plan: scene.bone_from_plan,
        device: link.info().scale,
        force_limit_n: args.force_limit,
        feel: *feel,
    }
}

/// Starts the servo thread and waits until it has asked for its rights.
fn start(thread: ServoThread, pace: (Master, u64), realtime: bool) -> anyhow::Result<Running> {
    let stop = Arc::new(AtomicBool::new(false));
    let (rights_in, rights_out) = sync_channel(1);
    let stop_flag = Arc::clone(&stop);
    let handle = std::thread::Builder::new()
        .name("servo".to_owned())
        .spawn(move || {
            let report = realtime.then(|| RtReport::ask(rt::servo_core()));
            let warnings = report.as_ref().map_or_else(
                || vec!["not real time: no rights were asked for (--no-realtime)".to_owned()],
                |report| report.warnings().collect(),
            );
            if rights_in.send(warnings).is_err() {
                stop_flag.store(true, Ordering::Relaxed);
            }
            servo_loop::run(thread, pace, &stop_flag)
        })
        .context("cannot start the servo thread")?;
    Ok(Running {
        thread: handle,
        stop,
        refused: rights_out
            .recv_timeout(Duration::from_secs(5))
            .context("the servo thread did not start")?,
        began: Instant::now(),
    })
}

/// Serves until the servo thread has ended by itself (false), or somebody wants the session's end (true).
fn serve_until_end(
    over: &dyn Fn() -> bool,
    (publisher, recorder): (&mut Publisher, Option<&Recorder>),
    running: &Running,
) -> bool {
    let mut notes = Notes::default();
    while !running.thread.is_finished() {
        if over() || publisher.visit(None) {
            return true;
        }
        if let Some(recorder) = recorder {
            notes.tell(publisher, recorder);
        }
        std::thread::sleep(VISIT);
    }
    false
}

/// Brings every viewer to the last brick, compares digests, reports.
fn finish(
    args: &HapticsArgs,
    session: &Session<'_>,
    (mut publisher, recorder): (Publisher, Option<Recorder>),
    outcome: &Outcome,
) -> anyhow::Result<()> {
    let &Session { tools, scene, feel } = session;
    let Outcome {
        finished, comings, ..
    } = outcome;
    let servo = &finished.thread.servo;
    while !publisher.records.is_empty() {
        publisher.drain();
    }
    if finished.behind() {
        publisher.catch_up(servo.cut());
    }
    let bone = &scene.bone;
    let servo_digest = servo.cut().digest(bone);
    let mirror_digest = publisher.mirror.cut.digest(bone);
    let viewer = last_digests(&mut publisher, wire_digest(mirror_digest));
    if let Some(log) = &mut publisher.pose_log {
        log.flush().context("pose log: cannot write its end")?;
    }
    // asked for, even where the device was away
    let failure = ending_text(&finished.ending).filter(|_| !outcome.asked);
    let ended = failure.clone().unwrap_or_else(|| "as asked".to_owned());
    let recording = recorder.map(|recorder| {
        // a tick that panicked has left the cut where no replay can
        let panicked = matches!(finished.ending, Ending::Panicked(_));
        let digest = (!panicked).then(|| wire_digest(servo_digest));
        recorder.finish(publisher.stats.ticks, digest, ended.clone())
    });
    let report = SessionReport::new(&Facts {
        scene,
        tools,
        feel,
        stats: &publisher.stats,
        passages: publisher.passages.report(tools),
        servo_digest,
        cut: servo.cut(),
        mirror_digest,
        link_name: publisher.link_name.clone(),
        link: comings.gone + finished.thread.link.stats(),
        reconnects: comings.reconnects,
        viewers: publisher.viewers.counts,
        viewer,
        strayed: publisher
            .viewers
            .reports()
            .filter(|r| r.digest != wire_digest(servo_digest))
            .count(),
        seconds: outcome.seconds,
        realtime_refused: outcome.refused.clone(),
        recording,
        ended,
    });
    publisher.viewers.farewell(clip(&report.ended));
    conclude(args, &report, failure)
}

/// Writes the report, and makes an error of what went wrong.
fn conclude(
    args: &HapticsArgs,
    report: &SessionReport,
    failure: Option<String>,
) -> anyhow::Result<()> {
    if let Some(path) = &args.json {
        serde_json::to_writer_pretty(BufWriter::new(create(path)?), report)
            .with_context(|| format!("{}: cannot write", path.display()))?;
    }
    match failure {
        Some(reason) => Err(anyhow!("{reason}")),
        None if !report.digests_agree() => {
            bail!(
                "the digests differ: {:?}; the viewers' bone is not the servo's",
                report.digest
            )
        }
        None => Ok(()),
    }
}

/// What is said of an ending that was not asked for.
pub(crate) fn ending_text(ending: &Ending) -> Option<String> {
    match ending {
        Ending::Stopped => None,
        Ending::Link(e) => Some(e.to_string()),
        Ending::Silent => {
            Some("the device sent nothing for 1 s; check its power and cable".to_owned())
        }
        Ending::Restarted => Some(
            "the device was restarted in the session and has lost its homing; dock the stylus and start anew"
                .to_owned(),
        ),
        Ending::Disarmed => Some(
            "the drive was disarmed in the session; end the other program that uses the device and start anew"
                .to_owned(),
        ),
        Ending::Panicked(message) => Some(format!(
            "the servo thread panicked ({message}); the motors were set to zero; please report this"
        )),
    }
}

/// Waits until every live viewer has answered the last digest, at most [`DIGEST_TIMEOUT`].
fn last_digests(publisher: &mut Publisher, digest: Digest) -> Option<ViewerReport> {
    let began = Instant::now();
    while began.elapsed() < DIGEST_TIMEOUT {
        publisher.visit(Some(digest));
        if publisher.viewers.all_answered() {
            break;
        }
        std::thread::sleep(VISIT);
    }
    publisher.viewers.reports().next()
}

#[expect(
    clippy::print_stdout,
    reason = "the one line that says that the session runs"
)]
pub(super) fn say(text: &str) {
    println!("{text}");
}
