//! The device's side of the link: a drive as a state machine, for a microcontroller or a simulation.
//!
//! Free of allocation, of a clock and of I/O: messages, sensor readings and the time go in, answers,
//! the state frame and the motors' DAC counts come out. All limits are in whole microseconds of the
//! device's own clock ([`limits`]). A firmware project owns three things: it reads [`Sensors`], it
//! sets what [`Firmware::dac`] and [`Firmware::motors_on`] say, and it moves the bytes of
//! [`Controller`].
//!
//! ```text
//! boot ─200 ms→ unhomed ─Home (docked)→ homed ─Arm, ArmConfirm{nonce}→ armed ─enable→ active
//!                                         ↑ 1 s without commands ───────┘ ←not enable─┘  │ ↑
//! any ─hard fault→ fault ─Disarm→ homed            tripped ←20 ms─ hold ←2 ms silence────┘ │
//!                                                     └─50 ms of healthy commands──────────┘
//! ```

mod config;
mod controller;
pub mod limits;
mod motors;

pub use config::DriveConfig;
pub use controller::Controller;

use crate::device::{
    CommandFrame, DeviceMessage, DriveState, HostMessage, StateFrame, fault, switch,
};
use crate::frame::is_newer;
use limits::{
    ARMED_IDLE_MICROS, BOOT_MICROS, HEALTHY_GAP_MICROS, HOLD_AFTER_MICROS, HOLD_UNTIL_MICROS,
    NONCE_MICROS, OVER_LIMIT_IN_A_ROW, RAMP_MICROS, REARM_MICROS, STALE_MICROS, TRIP_MICROS,
};
use motors::{scale, slew};

/// What the drive reads from its sensors once a period.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Sensors {
    /// Joint encoders, counts from an arbitrary power-up value.
    pub encoders: [i32; 3],
    /// Absolute gimbal sensors, counts.
    pub gimbal: [i16; 3],
    /// Pressed buttons and the dock switch, [`switch`] bits.
    pub switches: u8,
    /// Which joints touch their stop.
    pub at_stop: [bool; 3],
    /// Winding temperatures, °C.
    pub temperature: [i8; 3],
    /// The emergency stop is open. Its contact should cut the motors' supply as well.
    pub e_stop: bool,
    /// The self-test (supply, sensors, amplifiers, memory) has found a fault.
    pub self_test_failed: bool,
}

/// The drive.
#[derive(Debug, Clone)]
pub struct Firmware {
    config: DriveConfig,
    random: u64,
    drive: DriveState,
    now: u64,
    // raw encoder values in the dock; `None` until homed
    reference: Option<[i32; 3]>,
    last_encoders: Option<[i32; 3]>,
    nonce: Option<(u32, u64)>,
    // newest accepted command and when it came
    command: Option<(CommandFrame, u64)>,
    // when a re-arming drive began to hear healthy commands
    healthy_since: u64,
    armed_at: u64,
    ramp_from: u64,
    held: [i16; 3],
    applied: [i16; 3],
    over_limit: u8,
    latched: u16,
    passing: u16,
    frame_seq: u16,
    crc_errors: u8,
    refused: u8,
    trips: u8,
}

impl Firmware {
    /// A drive that powers up at time 0 of its clock. `seed` makes the nonces: take it from a source of
    /// noise.
    pub const fn new(config: DriveConfig, seed: u64) -> Self {
        Self {
            random: seed,
            drive: DriveState::Boot,
            now: 0,
            reference: None,
            last_encoders: None,
            nonce: None,
            command: None,
            healthy_since: 0,
            armed_at: 0,
            ramp_from: 0,
            held: [0; 3],
            applied: [0; 3],
            over_limit: 0,
            latched: 0,
            passing: 0,
            frame_seq: config.first_seq,
            crc_errors: 0,
            refused: 0,
            trips: 0,
            config,
        }
    }

    /// What this device is.
    pub const fn config(&self) -> &DriveConfig {
        &self.config
    }

    /// The newest command that was accepted in this session.
    pub fn newest_command(&self) -> Option<CommandFrame> {
        self.command.map(|(command, _)| command)
    }

    /// State of the drive.
    pub fn drive(&self) -> DriveState {
        self.drive
    }

    /// Torque at the motors now, DAC counts.
    pub fn dac(&self) -> [i16; 3] {
        self.applied
    }

    /// True where the amplifiers are on.
    pub fn motors_on(&self) -> bool {
        use DriveState::{Active, Armed, Hold};
        matches!(self.drive, Armed | Active | Hold)
    }

    /// Watchdog trips since power-up; wraps.
    pub fn trips(&self) -> u8 {
        self.trips
    }

    /// A frame came with a bad CRC or a bad shape.
    pub fn count_bad_frame(&mut self) {
        self.crc_errors = self.crc_errors.wrapping_add(1);
    }

    /// Takes one message at time `now` (µs) and gives the answer, if any.
    pub fn receive(
        &mut self,
        now: u64,
        message: HostMessage,
        sensors: &Sensors,
    ) -> Option<DeviceMessage> {
        self.pass_to(now);
        match message {
            HostMessage::HelloRequest { .. } => {
                self.begin_session();
                return Some(DeviceMessage::Hello(self.config.hello));
            }
            HostMessage::Command(command) => self.take_command(command),
            HostMessage::Home => self.home(sensors),
            HostMessage::Arm => return self.challenge(),
            HostMessage::ArmConfirm { nonce } => self.confirm(nonce),
            HostMessage::Disarm => self.disarm(),
        }
        None
    }

    /// One period of the drive at time `now` (µs): faults, watchdog, motor output, state frame.
    pub fn tick(&mut self, now: u64, sensors: &Sensors) -> StateFrame {
        self.pass_to(now);
        self.check_sensors(sensors);
        self.advance();
        self.drive_motors();
        self.report(sensors)
    }

    // A watchdog whose clock runs backwards guards nothing.
    fn pass_to(&mut self, now: u64) {
        if now < self.now {
            self.fail(fault::SELF_TEST);
        }
        self.now = self.now.max(now);
    }

    fn refuse(&mut self) {
        self.refused = self.refused.wrapping_add(1);
    }

    // A hello is a new host: it counts its commands anew and must arm before torque flows again.
    fn begin_session(&mut self) {
        self.command = None;
        self.nonce = None;
        if !matches!(self.drive, DriveState::Boot | DriveState::Fault) {
            self.motors_off_into(self.idle_state());
        }
    }

    fn home(&mut self, sensors: &Sensors) {
        let docked = sensors.switches & switch::DOCKED != 0;
        if docked && matches!(self.drive, DriveState::Unhomed | DriveState::Homed) {
            self.reference = Some(sensors.encoders);
            self.drive = DriveState::Homed;
        } else {
            self.refuse();
        }
    }

    fn challenge(&mut self) -> Option<DeviceMessage> {
        if self.drive != DriveState::Homed {
            self.refuse();
            return None;
        }
        // SplitMix64: one step a nonce, so that an old answer never fits a new challenge.
        self.random = self.random.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.random;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let nonce = (z >> 32) as u32;
        self.nonce = Some((nonce, self.now));
        Some(DeviceMessage::Challenge { nonce })
    }

    fn confirm(&mut self, answer: u32) {
        let fits = self.nonce.take().is_some_and(|(nonce, asked)| {
            nonce == answer && self.now - asked <= NONCE_MICROS && self.drive == DriveState::Homed
        });
        if fits {
            self.drive = DriveState::Armed;
            self.armed_at = self.now;
            self.command = None;
            self.over_limit = 0;
        } else {
            self.refuse();
        }
    }

    fn disarm(&mut self) {
        if self.drive != DriveState::Boot {
            self.latched = 0;
            self.over_limit = 0;
            self.nonce = None;
            self.motors_off_into(self.idle_state());
        }
    }

    fn idle_state(&self) -> DriveState {
        if self.reference.is_some() {
            DriveState::Homed
        } else {
            DriveState::Unhomed
        }
    }

    fn motors_off_into(&mut self, drive: DriveState) {
        self.drive = drive;
        self.applied = [0; 3];
        self.held = [0; 3];
    }

    fn fail(&mut self, bit: u16) {
        self.latched |= bit;
        self.motors_off_into(DriveState::Fault);
    }

    fn take_command(&mut self, command: CommandFrame) {
        let stale = self
            .command
            .is_some_and(|(newest, _)| !is_newer(command.seq, newest.seq));
        if stale || self.is_late(command) {
            self.refuse();
            return;
        }
        let most = self.config.hello.dac_max.unsigned_abs();
        if command.torque.iter().any(|t| t.unsigned_abs() > most) {
            self.refuse();
            self.passing |= fault::TORQUE_LIMIT;
            self.over_limit = self.over_limit.saturating_add(1);
            if self.over_limit >= OVER_LIMIT_IN_A_ROW && self.motors_on() {
                self.fail(fault::TORQUE_LIMIT);
            }
            return;
        }
        self.over_limit = 0;
        let gap = self.command.map_or(u64::MAX, |(_, at)| self.now - at);
        if gap > HEALTHY_GAP_MICROS {
            self.healthy_since = self.now;
        }
        self.command = Some((command, self.now));
        self.follow(command.enable);
    }

    // A torque that answers a state of long ago: it has waited in a queue, or the host hears nothing.
    // A zero is welcome whatever its age.
    fn is_late(&self, command: CommandFrame) -> bool {
        let behind = u64::from(self.frame_seq.wrapping_sub(command.state_seq));
        let age = behind * u64::from(self.config.hello.period_micros);
        command.torque != [0; 3] && age >= STALE_MICROS
    }

    // What a fresh command asks of the drive.
    fn follow(&mut self, enable: bool) {
        match (self.drive, enable) {
            (DriveState::Armed, true) => self.activate(),
            (DriveState::Active | DriveState::Hold, false) => {
                self.motors_off_into(DriveState::Armed);
                self.armed_at = self.now;
            }
            (DriveState::Hold, true) => self.drive = DriveState::Active,
            _ => {}
        }
    }

    fn activate(&mut self) {
        self.drive = DriveState::Active;
        self.ramp_from = self.now;
    }

    fn check_sensors(&mut self, sensors: &Sensors) {
        let limit = self.config.temperature_limit_c;
        let hot = sensors.temperature.iter().any(|&t| t >= limit);
        for (wrong, bit) in [
            (hot, fault::OVER_TEMPERATURE),
            (sensors.e_stop, fault::E_STOP),
            (sensors.self_test_failed, fault::SELF_TEST),
        ] {
            if wrong {
                self.fail(bit);
            }
        }
        let before = self.last_encoders.replace(sensors.encoders);
        for joint in (0..3).filter(|&joint| sensors.at_stop[joint]) {
            self.passing |= fault::JOINT_LIMIT;
            let moved = before.map_or(0, |b| sensors.encoders[joint].abs_diff(b[joint]));
            if moved > self.config.stop_speed_counts_per_tick && self.motors_on() {
                self.fail(fault::JOINT_LIMIT);
            }
        }
    }

    // Age of the newest command, µs; from arming where none has come yet.
    fn command_age(&self) -> u64 {
        let since = self.command.map_or(self.armed_at, |(_, at)| at);
        self.now - since.max(self.armed_at)
    }

    fn advance(&mut self) {
        let age = self.command_age();
        match self.drive {
            DriveState::Boot if self.now >= BOOT_MICROS => self.drive = DriveState::Unhomed,
            DriveState::Armed if age >= ARMED_IDLE_MICROS => {
                self.motors_off_into(DriveState::Homed);
            }
            DriveState::Active | DriveState::Hold if age >= TRIP_MICROS => {
                self.motors_off_into(DriveState::Tripped);
                self.trips = self.trips.wrapping_add(1);
            }
            DriveState::Active if age > HOLD_AFTER_MICROS => {
                self.drive = DriveState::Hold;
                self.held = self.applied;
            }
            DriveState::Tripped => self.try_rearm(age),
            _ => {}
        }
    }

    // Counted from command to command: silence re-arms nothing, however short.
    fn try_rearm(&mut self, age: u64) {
        let Some((command, at)) = self.command else {
            return;
        };
        if age > HOLD_AFTER_MICROS || at.saturating_sub(self.healthy_since) < REARM_MICROS {
            return;
        }
        if command.enable {
            self.activate();
        } else {
            self.drive = DriveState::Armed;
            self.armed_at = self.now;
        }
    }

    fn drive_motors(&mut self) {
        match (self.drive, self.command) {
            (DriveState::Active, Some((command, _))) => {
                let gain = (self.now - self.ramp_from).min(RAMP_MICROS);
                for (joint, rise) in self.config.slew_counts_per_tick.into_iter().enumerate() {
                    let wanted = scale(command.torque[joint], gain, RAMP_MICROS);
                    let limited = slew(self.applied[joint], wanted, rise);
                    if limited != wanted {
                        self.passing |= fault::SLEW_LIMIT;
                    }
                    self.applied[joint] = limited;
                }
            }
            (DriveState::Hold, _) => {
                let ramp = TRIP_MICROS - HOLD_UNTIL_MICROS;
                let left = TRIP_MICROS.saturating_sub(self.command_age()).min(ramp);
                self.applied = self.held.map(|torque| scale(torque, left, ramp));
            }
            _ => self.applied = [0; 3],
        }
    }

    fn report(&mut self, sensors: &Sensors) -> StateFrame {
        let reference = self.reference.unwrap_or([0; 3]);
        let tripped = u16::from(self.drive == DriveState::Tripped) * fault::WATCHDOG;
        let passing = core::mem::take(&mut self.passing);
        self.frame_seq = self.frame_seq.wrapping_add(1);
        StateFrame {
            seq: self.frame_seq,
            time_micros: (self.now & 0xffff_ffff) as u32,
            encoders: core::array::from_fn(|j| sensors.encoders[j].wrapping_sub(reference[j])),
            gimbal: sensors.gimbal,
            switches: sensors.switches,
            drive: self.drive,
            faults: self.latched | passing | tripped,
            applied: self.applied,
            temperature: sensors.temperature,
            ack: self.command.map_or(0, |(command, _)| command.seq),
            crc_errors: self.crc_errors,
            refused: self.refused,
            trips: self.trips,
        }
    }
}

#[cfg(test)]
mod tests;
