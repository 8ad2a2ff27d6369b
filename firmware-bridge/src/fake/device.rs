//! The simulated device as a whole, in its own time: drive, arm and hand, one millisecond a tick.
//!
//! No I/O and no clock: the pty loop drives it in real time, a lockstep test as fast as it can.

use super::faults::Fault;
use super::faults::sensors::SensorFault;
use super::hand::{Hand, Hold};
use super::plant::{ArmParameters, Plant, STEP_S, SUBSTEPS, gimbal_counts};
use super::stroke::Stroke;
use glam::DVec3;
use osteon_protocol::device::{DeviceMessage, DriveState, HostMessage, StateFrame, switch};
use osteon_protocol::firmware::limits::PERIOD_MICROS;
use osteon_protocol::firmware::{Controller, DriveConfig, Firmware, Sensors};
use osteon_protocol::frame::MAX_FRAME;
use osteon_sim_core::omni;

/// Ground truth at the sampling of one state frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// The frame's device time, µs; wraps with it.
    pub time_micros: u32,
    /// The frame's number.
    pub seq: u16,
    /// True gimbal centre, base frame, mm.
    pub gimbal_mm: DVec3,
    /// State of the drive.
    pub drive: DriveState,
    /// True where the amplifiers are on.
    pub motors_on: bool,
    /// Torque that the motors give at this moment, N·mm.
    pub torque_nmm: DVec3,
    /// Force of the hand on the stylus, base frame, N.
    pub hand_n: DVec3,
    /// Segment of the stroke: −1 in the dock, their number at the end.
    pub segment: i32,
}

/// How a device is built and held.
#[derive(Debug, Clone)]
pub struct DeviceSetup {
    /// What the hand is to do.
    pub stroke: Stroke,
    /// Who holds the stylus.
    pub hold: Hold,
    /// Makes nonces, the serial number and the encoders' values at power-up.
    pub seed: u64,
    /// Values of the encoders at power-up, counts; homing takes them away again.
    pub power_up: [i32; 3],
    /// Number of the last state frame before the first.
    pub first_seq: u16,
}

impl DeviceSetup {
    /// A device in a firm hand.
    pub fn new(stroke: Stroke, seed: u64) -> Self {
        // any start value does; in ±32 767
        let bytes = seed.rotate_left(5).to_le_bytes();
        Self {
            stroke,
            hold: Hold::default(),
            seed,
            power_up: [0, 2, 4].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]).into()),
            first_seq: 0,
        }
    }

    fn drive(&self) -> DriveConfig {
        DriveConfig {
            first_seq: self.first_seq,
            ..DriveConfig::omni((self.seed & 0xffff_ffff) as u32)
        }
    }
}

/// The simulated device.
#[derive(Debug, Clone)]
pub struct Device {
    controller: Controller,
    plant: Plant,
    hand: Hand,
    now_micros: u64,
    gimbal: [i16; 3],
    sensors: Sensors,
    fault: Option<SensorFault>,
    powered_up: u64,
    seed: u64,
}

impl Device {
    /// A device at power-up, its stylus in the dock. `seed` makes nonces and the encoders' power-up
    /// values.
    pub fn new(stroke: Stroke, seed: u64) -> Self {
        Self::build(DeviceSetup::new(stroke, seed))
    }

    /// As [`Self::new`], with more to choose.
    pub fn build(setup: DeviceSetup) -> Self {
        let arm = ArmParameters {
            grip_kg: setup.hold.mass_kg(),
            ..ArmParameters::default()
        };
        let mut device = Self {
            controller: Controller::new(setup.drive(), setup.seed),
            plant: Plant::new(arm, setup.power_up),
            hand: Hand::holding(setup.stroke, setup.hold),
            now_micros: 0,
            gimbal: [0; 3],
            sensors: Sensors::default(),
            fault: None,
            powered_up: 0,
            seed: setup.seed,
        };
        device.sensors = device.read_sensors();
        device
    }

    /// Makes a fault of the sensors begin.
    pub fn inject(&mut self, fault: Fault, seed: u64) {
        self.fault = Some(SensorFault::new(fault, seed));
    }

    /// The supply fails and comes back: the drive boots anew, the encoders have lost their count. Arm and
    /// hand stay where they are.
    pub fn brown_out(&mut self) {
        self.powered_up += 1;
        self.now_micros = 0;
        let config = *self.firmware().config();
        let seed = self.seed.wrapping_add(self.powered_up);
        self.controller = Controller::new(config, seed);
        let bytes = seed.rotate_left(17).to_le_bytes();
        self.plant
            .power_up([1, 3, 5].map(|at| i16::from_le_bytes([bytes[at], bytes[at + 1]]).into()));
        self.plant.set_drive([0; 3], false);
        self.sensors = self.read_sensors();
    }

    /// The drive.
    pub fn firmware(&self) -> &Firmware {
        self.controller.drive()
    }

    /// The hand.
    pub fn hand(&self) -> &Hand {
        &self.hand
    }

    /// The arm.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// Device time, µs.
    pub fn now_micros(&self) -> u64 {
        self.now_micros
    }

    /// A message came, other than as bytes of a frame, that was none.
    pub fn count_bad_frame(&mut self) {
        self.controller.count_bad_frame();
    }

    /// Moves arm and hand on by one period, with the torque that the drive set at its beginning.
    pub fn simulate(&mut self) {
        let engaged = matches!(
            self.firmware().drive(),
            DriveState::Active | DriveState::Hold
        );
        self.hand.plan(1e-3, &self.plant.motion(), engaged);
        if !self.hand.docked() {
            self.plant.release();
        }
        for _ in 0..SUBSTEPS {
            let force = self.hand.force(&self.plant.motion());
            self.plant.step(STEP_S, force);
        }
        self.now_micros += u64::from(PERIOD_MICROS);
        self.sensors = self.read_sensors();
    }

    /// Takes one message from the host, after [`Self::simulate`] and before [`Self::tick`].
    pub fn receive(&mut self, message: HostMessage) -> Option<DeviceMessage> {
        self.controller
            .receive(self.now_micros, message, &self.sensors)
    }

    /// Takes one byte of the cable, as [`Self::receive`] a message; what is returned is to be sent, empty
    /// where there is no answer.
    pub fn push<'a>(&mut self, byte: u8, out: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
        self.controller
            .push(self.now_micros, byte, &self.sensors, out)
    }

    /// One period of the drive: the torque for the next period, and the state to send.
    pub fn tick(&mut self) -> StateFrame {
        self.tick_frame(&mut [0; MAX_FRAME]).0
    }

    /// Whether the hand has come to the end of its stroke.
    pub fn hand_done(&self) -> bool {
        self.hand.done()
    }

    /// As [`Self::tick`], with the state's frame for the cable.
    pub fn tick_frame<'a>(&mut self, out: &'a mut [u8; MAX_FRAME]) -> (StateFrame, &'a [u8]) {
        let sent = self.controller.tick(self.now_micros, &self.sensors, out);
        let drive = self.controller.drive();
        self.plant.set_drive(drive.dac(), drive.motors_on());
        sent
    }

    /// Ground truth that belongs to the frame of the last [`Self::tick`].
    pub fn truth(&self, frame: &StateFrame) -> Truth {
        let motion = self.plant.motion();
        Truth {
            time_micros: frame.time_micros,
            seq: frame.seq,
            gimbal_mm: motion.position,
            drive: frame.drive,
            motors_on: self.firmware().motors_on(),
            torque_nmm: self.plant.torque_nmm(),
            hand_n: self.hand.force(&motion),
            segment: self.hand.segment(),
        }
    }

    fn read_sensors(&mut self) -> Sensors {
        // A rotation out of the wrist's description leaves the last reading.
        if let Some(angles) = omni::gimbal_for(self.plant.joints(), self.hand.rotation()) {
            self.gimbal = gimbal_counts(angles);
        }
        let docked = if self.hand.docked() {
            switch::DOCKED
        } else {
            0
        };
        let mut sensors = Sensors {
            encoders: self.plant.encoders(),
            gimbal: self.gimbal,
            switches: self.hand.buttons() | docked,
            at_stop: self.plant.at_stop(),
            temperature: self.plant.temperature(),
            e_stop: false,
            self_test_failed: false,
        };
        if let Some(fault) = &mut self.fault {
            fault.disturb(&mut sensors);
        }
        sensors
    }
}

#[cfg(test)]
mod tests;
