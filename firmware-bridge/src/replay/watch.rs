//! Watching a session again: a viewer sees it as it saw the live one, at any speed, from any moment on.

use super::film::Film;
use super::orders::{Order, Orders};
use crate::haptics::{Session, publisher_of, socket};
use crate::recording::{Moved, Reader, restore};
use anyhow::Context as _;
use osteon_sim_core::servo::Request;
use rtrb::{Consumer, RingBuffer};
use std::path::Path;
use std::time::{Duration, Instant};

/// Time between two visits of the publisher.
const VISIT: Duration = Duration::from_millis(4);
/// Longest time that is played without a visit.
const BUSY: Duration = Duration::from_millis(40);

/// How a session is to be watched.
pub(crate) struct Watching<'a> {
    pub file: &'a Path,
    pub moved: &'a Moved,
    pub socket: &'a Path,
    pub speed: f64,
    pub from_s: f64,
}

/// Where the film is, and whether it runs.
struct Clock {
    at_ns: f64,
    speed: f64,
    playing: bool,
    last: Instant,
}

impl Clock {
    /// Lets time pass; the moment up to which is to be played, ns.
    fn advance(&mut self) -> f64 {
        let now = Instant::now();
        if self.playing {
            self.at_ns += now.duration_since(self.last).as_secs_f64() * 1e9 * self.speed;
        }
        self.last = now;
        self.at_ns
    }
}

/// Serves viewers until one of them, or the keyboard, ends it.
pub(crate) fn watch(watching: &Watching<'_>) -> anyhow::Result<()> {
    let stop = crate::stop::on_signals()?;
    let setup = Reader::open(watching.file)?.setup().clone();
    let restored = restore(&setup, watching.moved)?;
    let listener = socket::listen(watching.socket)?;
    let (_records, records_out) = RingBuffer::new(1);
    let (requests_in, mut requests) = RingBuffer::new(64);
    let session = Session {
        tools: &restored.tools,
        scene: &restored.scene,
        feel: &restored.feel,
    };
    let name = format!("replay of {}", setup.device.link);
    let rings = (records_out, requests_in);
    let publisher = publisher_of(&session, setup.force_limit_n, (listener, name), rings);
    let mut film = Film::new(watching.file, restored.servo, publisher)?;
    say(&format!(
        "replay: {} s of {}; watch it with 'osteon view --socket {}'\n{}",
        film.seconds(),
        watching.file.display(),
        watching.socket.display(),
        Orders::HELP
    ));
    film.seek(watching.from_s)?;
    let mut clock = Clock {
        at_ns: film.now_ns(),
        speed: watching.speed,
        playing: true,
        last: Instant::now(),
    };
    let orders = Orders::from_keyboard().context("cannot listen to the keyboard")?;
    while !stop.load(std::sync::atomic::Ordering::Relaxed) {
        let mut asked = orders.waiting();
        asked.extend(wishes(&mut requests, clock.playing));
        for order in asked {
            if obey(order, &mut film, &mut clock)? {
                return film.end();
            }
        }
        let until = clock.advance();
        let busy = Instant::now();
        while film.now_ns() < until && busy.elapsed() < BUSY {
            if !film.play_next()? {
                clock.playing = false;
                break;
            }
        }
        if film.now_ns() < until {
            // slower than asked for, or at the end: the clock waits for the film
            clock.at_ns = film.now_ns();
        }
        if film.visit() {
            break;
        }
        std::thread::sleep(VISIT);
    }
    film.end()
}

/// What viewers ask for, as far as a film can do it: pause, and reset, which is the beginning.
fn wishes(requests: &mut Consumer<Request>, playing: bool) -> Vec<Order> {
    let mut orders = Vec::new();
    while let Ok(request) = requests.pop() {
        match request {
            // the viewer asks by what it sees of the session's own pauses
            Request::Pause(_) if playing => orders.push(Order::Pause),
            Request::Pause(_) => orders.push(Order::Play),
            Request::Reset => orders.push(Order::Seek(0.0)),
            _ => {}
        }
    }
    orders
}

/// Does what is asked; true where that is the end.
fn obey(order: Order, film: &mut Film, clock: &mut Clock) -> anyhow::Result<bool> {
    match order {
        Order::Play => clock.playing = true,
        Order::Pause => clock.playing = false,
        Order::Speed(speed) => clock.speed = speed,
        Order::Seek(seconds) => film.seek(seconds)?,
        Order::Step(ticks) => {
            clock.playing = false;
            film.step(ticks)?;
        }
        Order::Quit => return Ok(true),
    }
    clock.at_ns = film.now_ns();
    clock.last = Instant::now();
    say(&format!(
        "replay: {:.3} s, {}, speed {}",
        film.now_ns() * 1e-9,
        if clock.playing { "playing" } else { "paused" },
        clock.speed
    ));
    Ok(false)
}

#[expect(clippy::print_stdout, reason = "the words of a command-line program")]
fn say(text: &str) {
    println!("{text}");
}
