//! A simulated arm behind an hfab controller: the text protocol, its watchdog of 100 ms and its habits.
//!
//! The firmware answers each command, applies 0 where a current is above 6 A, and lets the amplifiers go
//! 100 ms after the last good command. Until then the last current flows, whatever has become of the host.
//! The arm is three joints of constant inertia with viscous friction: enough to tell senses, gears and
//! scales apart, no more.

use super::device::Truth;
use super::faults::{Fault, Planned};
use super::port::Port;
use super::run::{FakeArgs, MAX_CATCH_UP_NS, PERIOD_NS};
use super::truth::TruthLog;
use crate::rt;
use anyhow::{Context as _, ensure};
use glam::DVec3;
use osteon_protocol::device::DriveState;
use osteon_protocol::hfab::{
    HfabError, HfabState, LineReader, MAX_LINE, MAX_MILLIAMPS, WATCHDOG_MS, error, write_line,
};
use osteon_sim_core::arm::{Arm, Phantom, VINTAGE, WOODEN};
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Inertia of each joint, kg·m², and its viscous friction, N·m·s/rad.
const INERTIA: f64 = 3e-3;
const VISCOUS: f64 = 2e-2;
const SUBSTEPS: u32 = 20;

/// Model number and link of `hfab2:PATH` or `hfab3:PATH`.
pub fn asked_for(link: &Path) -> Option<(i32, PathBuf)> {
    let text = link.to_str()?;
    [(2, "hfab2:"), (3, "hfab3:")]
        .into_iter()
        .find_map(|(model, kind)| text.strip_prefix(kind).map(|path| (model, path.into())))
}

/// Firmware and arm, without I/O.
#[derive(Debug, Clone)]
pub struct HfabDevice {
    model: i32,
    arm: &'static Phantom,
    q: DVec3,
    speed: DVec3,
    milliamps: [i32; 3],
    silent_ms: u32,
    enabled: bool,
    reader: LineReader<3>,
}

impl HfabDevice {
    /// A device that was just calibrated, in its home pose. `None` for a model that is not simulated.
    pub fn new(model: i32) -> Option<Self> {
        let arm = match model {
            2 => &VINTAGE,
            3 => &WOODEN,
            _ => return None,
        };
        Some(Self {
            model,
            arm,
            q: DVec3::from_array(arm.home),
            speed: DVec3::ZERO,
            milliamps: [0; 3],
            silent_ms: WATCHDOG_MS,
            enabled: false,
            reader: LineReader::new(),
        })
    }

    /// Moves the arm on by one millisecond.
    pub fn simulate(&mut self) {
        self.silent_ms = self.silent_ms.saturating_add(1);
        if self.silent_ms >= WATCHDOG_MS {
            self.enabled = false;
            self.milliamps = [0; 3];
        }
        let torque_nm = self.torque_nmm() * 1e-3;
        let dt = 1e-3 / f64::from(SUBSTEPS);
        for _ in 0..SUBSTEPS {
            self.speed += (torque_nm - self.speed * VISCOUS) / INERTIA * dt;
            self.q += self.speed * dt;
        }
    }

    /// Takes one byte; at the end of a line the answer to it.
    pub fn receive(&mut self, byte: u8) -> Option<HfabState> {
        let error = match self.reader.push(byte)? {
            Ok(wanted) => {
                self.silent_ms = 0;
                self.enabled = true;
                let most = i32::from(MAX_MILLIAMPS);
                self.milliamps = wanted.map(|m| if m.abs() <= most { m } else { 0 });
                0
            }
            Err(HfabError::Count) => error::COUNT,
            Err(HfabError::Byte | HfabError::Number) => error::PARSE,
        };
        let [e0, e1, e2] = self.counts();
        Some(HfabState {
            model: self.model,
            encoders: [e0, e1, e2, 0, 0, 0],
            error,
        })
    }

    /// Torque at the joints, N·mm.
    pub fn torque_nmm(&self) -> DVec3 {
        if !self.enabled {
            return DVec3::ZERO;
        }
        let amps = DVec3::from_array(self.milliamps.map(|m| f64::from(m) * 1e-3));
        amps * self.arm.nmm_per_ampere * DVec3::from_array(self.arm.gear)
    }

    /// The gimbal's centre, base frame, mm.
    pub fn position_mm(&self) -> DVec3 {
        Arm::Phantom(self.arm).forward(self.q)
    }

    #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
    fn counts(&self) -> [i32; 3] {
        let per_rad = f64::from(self.arm.counts_per_rev) / core::f64::consts::TAU;
        let way = self.q - DVec3::from_array(self.arm.home);
        let counts = way * DVec3::from_array(self.arm.gear) * per_rad;
        // between two counts at home, so that it reads the same every time
        counts.to_array().map(|n| (n + 0.5).floor() as i32)
    }
}

/// Serves a host until `stop`, or for `--seconds`; what happened, in a line.
pub(super) fn serve(
    model: i32,
    link: &Path,
    args: &FakeArgs,
    (stop, out): (&AtomicBool, &mut dyn Write),
) -> anyhow::Result<String> {
    let known = args.fault.iter().all(|p| p.fault == Fault::Unplug);
    ensure!(
        known,
        "fake-omni: of an hfab device only 'unplug' is simulated"
    );
    let mut bench = HfabBench {
        device: HfabDevice::new(model).context("fake-omni: no such model")?,
        port: Some(Port::open(link)?),
        answered: 0,
        refused: 0,
    };
    let mut truth = args.truth.as_deref().map(TruthLog::create).transpose()?;
    writeln!(
        out,
        "fake-omni: hfab model {model} ready at {}",
        link.display()
    )?;
    out.flush()?;
    let mut deadline = rt::now_ns();
    for tick in 0..args.ticks() {
        deadline += PERIOD_NS;
        // the firmware answers at once: bytes are looked for four times in a period
        for part in (0..4).rev() {
            rt::sleep_until(deadline - part * PERIOD_NS / 4);
            bench.answer();
        }
        if stop.load(Ordering::Relaxed) {
            break;
        }
        let late = rt::now_ns().saturating_sub(deadline);
        if late > MAX_CATCH_UP_NS {
            deadline += late;
        }
        for &planned in &args.fault {
            bench.move_plug(planned, tick, link)?;
        }
        bench.device.simulate();
        if bench.device.silent_ms == 5 * WATCHDOG_MS
            && let Some(port) = &bench.port
        {
            port.release_claim();
        }
        if let Some(truth) = &mut truth {
            truth.push(bench.device.truth(tick));
        }
    }
    truth.map_or(Ok(()), TruthLog::finish)?;
    Ok(format!(
        "{} commands, {} refused",
        bench.answered, bench.refused
    ))
}

/// The device and its cable; no port while the plug is out.
struct HfabBench {
    device: HfabDevice,
    port: Option<Port>,
    answered: u64,
    refused: u64,
}

impl HfabBench {
    /// Answers the lines that have come.
    fn answer(&mut self) {
        let Some(port) = &mut self.port else {
            return;
        };
        let mut bytes = [0; 1024];
        let count = port.read(&mut bytes);
        for &byte in &bytes[..count] {
            let Some(state) = self.device.receive(byte) else {
                continue;
            };
            self.answered += 1;
            self.refused += u64::from(state.error != 0);
            let mut line = [0; MAX_LINE];
            // an answer that a host does not read is lost
            let _taken = port.write_frame(write_line(&state.numbers(), &mut line));
        }
    }

    /// Pulls the plug and puts it back, as planned.
    fn move_plug(&mut self, planned: Planned, tick: u64, link: &Path) -> anyhow::Result<()> {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a time in 0 to 1e5 s"
        )]
        let at = (planned.at_s * 1000.0) as u64;
        if tick == at {
            self.port = None;
        }
        if tick == at + u64::from(planned.entry().lasts_ms) {
            self.port = Some(Port::open(link)?);
        }
        Ok(())
    }
}

impl HfabDevice {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "numbers that wrap by design"
    )]
    fn truth(&self, tick: u64) -> Truth {
        Truth {
            time_micros: (tick * 1000) as u32,
            seq: tick as u16,
            gimbal_mm: self.position_mm(),
            drive: if self.enabled {
                DriveState::Active
            } else {
                DriveState::Tripped
            },
            motors_on: self.enabled,
            torque_nmm: self.torque_nmm(),
            hand_n: DVec3::ZERO,
            segment: -1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn say(device: &mut HfabDevice, line: &str) -> Vec<HfabState> {
        line.bytes().filter_map(|b| device.receive(b)).collect()
    }

    #[test]
    fn currents_flow_for_a_tenth_of_a_second_after_the_last_command() {
        let mut device = HfabDevice::new(3).unwrap();
        assert_eq!(device.torque_nmm(), DVec3::ZERO);
        let answer = say(&mut device, "[1000,0,0]\n");
        assert_eq!(answer[0].numbers(), [3, 0, 0, 0, 0, 0, 0, 0]);
        // 1 A × 25.9 N·mm/A × 16, against the joint's sense
        assert!((device.torque_nmm().x + 414.4).abs() < 1e-9);
        for ms in 1..=120 {
            device.simulate();
            assert_eq!(device.torque_nmm() != DVec3::ZERO, ms < 100, "{ms}");
        }
        // too much is nothing, not the most
        say(&mut device, "[6001,-6000,0]\n");
        assert!(device.torque_nmm().x.abs() < 1e-9 && device.torque_nmm().y < -1.0);
        assert_eq!(say(&mut device, "[1,2]\n")[0].error, error::COUNT);
        assert!(HfabDevice::new(1).is_none());
    }
}
