//! What the keyboard orders, a line each.

use std::io::BufRead as _;
use std::sync::mpsc::{Receiver, sync_channel};

/// Fastest and slowest film.
pub(super) const SPEEDS: core::ops::RangeInclusive<f64> = 0.01..=100.0;

/// One order.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Order {
    /// Go on.
    Play,
    /// Stop where it is.
    Pause,
    /// Times real time.
    Speed(f64),
    /// To a moment of the session, s.
    Seek(f64),
    /// So many ticks on, or back.
    Step(i64),
    /// End.
    Quit,
}

impl Order {
    /// The order of a line; what is wrong with it otherwise.
    pub(super) fn of(line: &str) -> Result<Self, String> {
        let mut words = line.split_whitespace();
        let (name, value) = (words.next().unwrap_or(""), words.next());
        let number = |what: &str| {
            let text = value.ok_or(format!("'{name}' needs {what}"))?;
            let number = text.parse::<f64>().ok().filter(|n| n.is_finite());
            number.ok_or(format!("'{text}' is not {what}"))
        };
        match name {
            "play" => Ok(Self::Play),
            "pause" => Ok(Self::Pause),
            "quit" => Ok(Self::Quit),
            "speed" => match number("a speed, such as 0.25")? {
                speed if SPEEDS.contains(&speed) => Ok(Self::Speed(speed)),
                speed => Err(format!("a speed of {speed}; from 0.01 to 100 are possible")),
            },
            "seek" => Ok(Self::Seek(number("a time, s")?.max(0.0))),
            "step" => {
                let ticks = value.unwrap_or("1").parse();
                ticks
                    .map(Self::Step)
                    .map_err(|e| format!("'{}': {e}", value.unwrap_or("")))
            }
            _ => Err(format!("'{name}' is no order; {}", Orders::HELP)),
        }
    }
}

/// The orders that come in.
pub(super) struct Orders(Receiver<Order>);

impl Orders {
    /// All orders.
    pub(super) const HELP: &'static str = "orders: play, pause, speed X, seek SECONDS, step [TICKS], quit; in the viewer P pauses and R goes to the beginning";

    /// Listens to standard input, which may be closed.
    #[expect(clippy::print_stderr, reason = "what is wrong with an order")]
    pub(super) fn from_keyboard() -> std::io::Result<Self> {
        let (sender, orders) = sync_channel(64);
        std::thread::Builder::new()
            .name("orders".to_owned())
            .spawn(move || {
                for line in std::io::stdin().lock().lines().map_while(Result::ok) {
                    if line.trim().is_empty() {
                        continue;
                    }
                    match Order::of(&line) {
                        Ok(order) => {
                            if sender.send(order).is_err() {
                                return;
                            }
                        }
                        Err(why) => eprintln!("replay: {why}"),
                    }
                }
            })?;
        Ok(Self(orders))
    }

    /// Those that have come.
    pub(super) fn waiting(&self) -> Vec<Order> {
        self.0.try_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_and_what_is_none() {
        for (line, order) in [
            ("play", Order::Play),
            (" pause ", Order::Pause),
            ("speed 0.25", Order::Speed(0.25)),
            ("seek 12.5", Order::Seek(12.5)),
            ("seek -1", Order::Seek(0.0)),
            ("step", Order::Step(1)),
            ("step -20", Order::Step(-20)),
            ("quit", Order::Quit),
        ] {
            assert_eq!(Order::of(line), Ok(order), "{line}");
        }
        for line in ["speed", "speed 0", "speed nan", "seek x", "step 1.5", "fly"] {
            assert!(Order::of(line).is_err(), "{line}");
        }
    }
}
