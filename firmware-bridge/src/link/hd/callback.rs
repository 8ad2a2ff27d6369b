//! What happens in the library's own 1 kHz thread: state out, newest force in, and a watchdog.

use super::super::mailbox::Outlet;
use super::super::{LinkError, LinkStats};
use super::ffi::{Hd, Work, code};
use super::{COUNTS_PER_MM, GIMBAL_COUNTS, NEWTON_PER_COUNT};
use crate::rt::now_ns;
use glam::{DMat3, DQuat, DVec3};
use osteon_protocol::device::{DriveState, StateFrame, fault, switch};
use osteon_sim_core::omni;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

/// Age of the newest command up to which its force is held, and at which it is zero, periods.
const HOLD: u32 = 5;
const OFF: u32 = 20;
/// After a trip the force comes back over so many periods of healthy commands.
const RAMP: u32 = 50;
/// Most errors read in one period.
const MOST_ERRORS: usize = 8;
/// Times in a row that the matrix may be no pose.
const MOST_BAD: u32 = 20;

/// What servo thread and callback share.
#[derive(Debug, Default)]
pub(super) struct Shared {
    /// Number and forces of the newest command; 0 = none.
    pub(super) command: AtomicU64,
    /// Forces are wanted.
    pub(super) live: AtomicBool,
    /// Periods since the callback began.
    pub(super) periods: AtomicU32,
}

impl Shared {
    pub(super) fn store(&self, seq: u16, force: [i16; 3]) {
        let [a, b, c] = force.map(|t| u64::from(t.cast_unsigned()));
        let word = u64::from(seq.max(1)) | a << 16 | b << 32 | c << 48;
        self.command.store(word, Ordering::Release);
    }

    fn load(&self) -> (u16, [i16; 3]) {
        let word = self.command.load(Ordering::Acquire);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "one of four words of 16 bits"
        )]
        let part = |n: u32| (word >> (16 * n)) as u16;
        (part(0), [1, 2, 3].map(|n| part(n).cast_signed()))
    }
}

/// The callback's own state.
#[derive(Debug)]
pub(super) struct Callback {
    pub(super) name: Arc<str>,
    pub(super) hd: &'static Hd,
    pub(super) device: u32,
    pub(super) shared: Arc<Shared>,
    pub(super) outlet: Outlet,
    pub(super) watch: Watch,
    pub(super) seq: u16,
    pub(super) bad: u32,
    pub(super) faults: u16,
    pub(super) stats: LinkStats,
}

/// The watchdog: what of the newest command is shown.
#[derive(Debug, Default)]
pub(super) struct Watch {
    seen: u16,
    age: u32,
    // periods of healthy commands since the last trip, up to RAMP
    healthy: u32,
    trips: u8,
    applied: [i16; 3],
}

impl Watch {
    /// One period with the newest command; `live`: forces are wanted.
    fn show(&mut self, (seq, wanted): (u16, [i16; 3]), live: bool) -> (DriveState, [i16; 3]) {
        if seq == self.seen {
            self.age = self.age.saturating_add(1);
        } else {
            (self.seen, self.age) = (seq, 0);
        }
        if self.age == OFF && live {
            self.trips = self.trips.wrapping_add(1);
        }
        if !live || self.age >= OFF {
            self.healthy = 0;
        } else {
            self.healthy = (self.healthy + 1).min(RAMP);
        }
        let rest = f64::from(OFF - self.age.clamp(HOLD, OFF)) / f64::from(OFF - HOLD);
        let share = rest * f64::from(self.healthy) / f64::from(RAMP);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "smaller than the i16 it was made of"
        )]
        let part = wanted.map(|t| (f64::from(t) * share) as i16);
        self.applied = if live { part } else { [0; 3] };
        let drive = match self.age {
            _ if !live => DriveState::Armed,
            0..=1 => DriveState::Active,
            2..OFF => DriveState::Hold,
            _ => DriveState::Tripped,
        };
        (drive, self.applied)
    }
}

impl Work for Callback {
    fn tick(&mut self) -> bool {
        let outcome = catch_unwind(AssertUnwindSafe(|| self.period()));
        self.shared.periods.fetch_add(1, Ordering::Release);
        match outcome {
            Ok(Ok(())) => true,
            Ok(Err(error)) => self.end(error),
            Err(_) => self.end(LinkError::Setup {
                link: Arc::clone(&self.name),
                why: "a fault of this program in the library's thread; please report this"
                    .to_owned(),
            }),
        }
    }
}

impl Callback {
    fn period(&mut self) -> Result<(), LinkError> {
        self.hd.make_current(self.device);
        self.hd.begin_frame(self.device);
        // torque that was in force up to now: that of the last period
        let before = self.watch.applied;
        let transform = self.hd.transform();
        let buttons = self.hd.buttons();
        let docked = self.hd.in_inkwell();
        let live = self.shared.live.load(Ordering::Acquire);
        let command = self.shared.load();
        let (drive, applied) = self.watch.show(command, live);
        self.hd
            .set_force(applied.map(|t| f64::from(t) * NEWTON_PER_COUNT));
        self.hd.end_frame(self.device);
        self.read_errors()?;
        let Some((encoders, gimbal)) = counts(&transform) else {
            self.bad += 1;
            self.stats.crc_errors += 1;
            return if self.bad < MOST_BAD {
                Ok(())
            } else {
                Err(LinkError::Setup {
                    link: Arc::clone(&self.name),
                    why: "the library gives no pose".to_owned(),
                })
            };
        };
        self.bad = 0;
        self.seq = self.seq.wrapping_add(1);
        self.stats.frames += 1;
        let buttons = u8::try_from(buttons & 3).unwrap_or(0);
        #[expect(
            clippy::cast_possible_truncation,
            reason = "microseconds wrap by design"
        )]
        let time_micros = (now_ns() / 1000) as u32;
        let tripped = drive == DriveState::Tripped;
        let state = StateFrame {
            seq: self.seq,
            time_micros,
            encoders,
            gimbal,
            switches: buttons | if docked { switch::DOCKED } else { 0 },
            drive,
            faults: self.faults | if tripped { fault::WATCHDOG } else { 0 },
            applied: before,
            temperature: [0; 3],
            ack: self.watch.seen,
            crc_errors: 0,
            refused: 0,
            trips: self.watch.trips,
        };
        self.outlet.put(Ok((state, self.stats)));
        Ok(())
    }

    /// What the library complained of in this period.
    fn read_errors(&mut self) -> Result<(), LinkError> {
        self.faults = 0;
        for _ in 0..MOST_ERRORS {
            let error = self.hd.error();
            self.faults |= match error.code {
                0 => return Ok(()),
                code::WARM_MOTORS => fault::OVER_TEMPERATURE,
                code::MAX_FORCE | code::MAX_IMPULSE | code::MAX_VELOCITY | code::FORCE_ERROR => {
                    fault::TORQUE_LIMIT
                }
                code::DEVICE_FAULT | code::COMM_ERROR | code::COMM_CONFIG | code::TIMER => {
                    return Err(super::refusal(self.hd, &self.name, "the 1 kHz loop", error));
                }
                // a note about a call, which a later period repeats
                _ => 0,
            };
        }
        Ok(())
    }

    /// No force, and the reason to the servo.
    fn end(&mut self, error: LinkError) -> bool {
        self.hd.make_current(self.device);
        self.hd.begin_frame(self.device);
        self.hd.set_force([0.0; 3]);
        self.hd.end_frame(self.device);
        self.outlet.put(Err(error));
        false
    }
}

/// Position and angles of a column-major pose as counts; `None` where it is none.
pub(super) fn counts(transform: &[f64; 16]) -> Option<([i32; 3], [i16; 3])> {
    let column =
        |n: usize| DVec3::new(transform[4 * n], transform[4 * n + 1], transform[4 * n + 2]);
    let rotation = DMat3::from_cols(column(0), column(1), column(2));
    let square = rotation * rotation.transpose() - DMat3::IDENTITY;
    let straight = [square.x_axis, square.y_axis, square.z_axis]
        .iter()
        .all(|c| c.abs().max_element() < 1e-3);
    let position = column(3);
    if !(straight && rotation.determinant() > 0.0 && position.abs().max_element() < 2000.0) {
        return None;
    }
    let base_from_stylus = DQuat::from_mat3(&rotation);
    let length = base_from_stylus.length();
    let unit = base_from_stylus * length.recip();
    let angles = omni::gimbal_for(DVec3::ZERO, unit)?;
    let per_mm = f64::from(COUNTS_PER_MM);
    let per_rad = f64::from(GIMBAL_COUNTS) / core::f64::consts::TAU;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "bounded above; a half turn saturates"
    )]
    let floor = |v: f64| v.floor() as i32;
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a half turn is 16,384 counts"
    )]
    let turn = |v: f64| (v * per_rad).floor() as i16;
    Some((
        position.to_array().map(|v| floor(v * per_mm)),
        angles.to_array().map(turn),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_watchdog_holds_ramps_and_comes_back_slowly() {
        let mut watch = Watch::default();
        let wanted = [1000, -500, 0];
        for seq in 1..=60 {
            watch.show((seq, wanted), true);
        }
        assert_eq!(watch.applied, wanted);
        // silence: held for 5 periods, then down, off at 20
        let mut shown = Vec::new();
        for _ in 0..25 {
            shown.push(watch.show((60, wanted), true));
        }
        assert!(shown[..5].iter().all(|s| s.1 == wanted), "{shown:?}");
        assert!(shown.windows(2).all(|w| w[1].1[0] <= w[0].1[0]));
        assert!(shown[18].1[0] > 0 && shown[19].1 == [0; 3], "{shown:?}");
        assert_eq!(shown[19].0, DriveState::Tripped);
        assert_eq!(watch.trips, 1);
        // it comes back in small steps
        let mut last = 0;
        for seq in 61..=120 {
            let (_, now) = watch.show((seq, wanted), true);
            assert!(
                (0..=20).contains(&(now[0] - last)),
                "{} after {last}",
                now[0]
            );
            last = now[0];
        }
        assert_eq!(last, 1000);
        assert_eq!(
            watch.show((121, wanted), false),
            (DriveState::Armed, [0; 3])
        );
    }

    #[test]
    fn a_pose_makes_the_round_trip_through_counts() {
        for n in 0..300 {
            let t = f64::from(n);
            let axis = DVec3::new(libm::sin(t), libm::cos(t * 1.3), libm::sin(t * 0.7 + 1.0));
            let Some(axis) = axis.try_normalize() else {
                continue;
            };
            let turn = DQuat::from_axis_angle(axis, t * 0.02);
            let m = DMat3::from_quat(turn);
            let p = axis * 120.0;
            let c = [m.x_axis, m.y_axis, m.z_axis, p];
            let mut matrix = [0.0; 16];
            for (k, column) in c.iter().enumerate() {
                matrix[4 * k..4 * k + 3].copy_from_slice(&column.to_array());
            }
            matrix[15] = 1.0;
            let (encoders, gimbal) = counts(&matrix).expect("a pose");
            let scale = super::super::scale(3.3);
            let q = scale.arm.coordinates(encoders, &scale);
            let back = scale.arm.stylus(q, scale.arm.gimbal(gimbal, &scale));
            assert!((back.translation - p).length() < 1e-3, "{n}");
            let angle = 2.0 * libm::acos(back.rotation.dot(turn).abs().min(1.0));
            assert!(angle < 6e-4, "{n}: {angle}");
        }
        let mut flat = [0.0; 16];
        assert_eq!(counts(&flat), None);
        flat[0] = f64::NAN;
        assert_eq!(counts(&flat), None);
    }
}
