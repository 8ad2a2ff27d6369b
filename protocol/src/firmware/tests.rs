use super::limits::{DAC_MAX, SLEW_COUNTS_PER_MS, STOP_SPEED_COUNTS_PER_MS, TEMPERATURE_LIMIT_C};
use super::*;
use crate::device::{DEVICE_SCHEMA, DEVICE_VERSION};

const DOCKED: Sensors = Sensors {
    encoders: [10, -20, 30],
    gimbal: [0; 3],
    switches: switch::DOCKED,
    at_stop: [false; 3],
    temperature: [25; 3],
    e_stop: false,
    self_test_failed: false,
};

/// A drive on a virtual clock in whole milliseconds.
struct Rig {
    drive: Firmware,
    sensors: Sensors,
    ms: u64,
    seq: u16,
}

impl Rig {
    fn new() -> Self {
        Self {
            drive: Firmware::new(DriveConfig::omni(7), 99),
            sensors: DOCKED,
            ms: 0,
            seq: 0,
        }
    }

    fn tick(&mut self) -> StateFrame {
        self.ms += 1;
        self.drive.tick(self.ms * 1000, &self.sensors)
    }

    fn ticks(&mut self, count: u64) -> StateFrame {
        let mut frame = self.tick();
        for _ in 1..count {
            frame = self.tick();
        }
        frame
    }

    fn tell(&mut self, message: HostMessage) -> Option<DeviceMessage> {
        // Messages are read just before the next tick.
        self.drive
            .receive((self.ms + 1) * 1000, message, &self.sensors)
    }

    fn command(&mut self, torque: [i16; 3], enable: bool) -> StateFrame {
        self.seq = self.seq.wrapping_add(1).max(1);
        let command = CommandFrame {
            seq: self.seq,
            state_seq: self.drive.frame_seq,
            torque,
            enable,
        };
        self.tell(HostMessage::Command(command));
        self.tick()
    }

    fn nonce(&mut self) -> u32 {
        match self.tell(HostMessage::Arm) {
            Some(DeviceMessage::Challenge { nonce }) => nonce,
            other => panic!("no challenge but {other:?}"),
        }
    }

    fn armed() -> Self {
        let mut rig = Self::new();
        rig.ticks(200);
        rig.tell(HostMessage::Home);
        let nonce = rig.nonce();
        rig.tell(HostMessage::ArmConfirm { nonce });
        assert_eq!(rig.tick().drive, DriveState::Armed);
        rig
    }

    /// Active, past the ramp, at `torque`.
    fn active(torque: [i16; 3]) -> Self {
        let mut rig = Self::armed();
        let mut frame = rig.command(torque, true);
        for _ in 0..60 {
            frame = rig.command(torque, true);
        }
        assert_eq!(frame.drive, DriveState::Active);
        assert_eq!(frame.applied, torque);
        rig
    }
}

#[test]
fn boot_takes_200_ms_and_nothing_shortens_it() {
    let mut rig = Rig::new();
    rig.tell(HostMessage::Home);
    rig.tell(HostMessage::Disarm);
    assert_eq!(rig.ticks(199).drive, DriveState::Boot);
    assert_eq!(rig.tick().drive, DriveState::Unhomed);
}

#[test]
fn a_hello_is_answered_in_every_state_with_what_the_numbers_mean() {
    let mut rig = Rig::new();
    let ask = HostMessage::HelloRequest {
        version: 999,
        schema: 0,
    };
    let Some(DeviceMessage::Hello(hello)) = rig.tell(ask) else {
        panic!("no hello");
    };
    assert_eq!(
        (hello.version, hello.model, hello.serial),
        (DEVICE_VERSION, 1, 7)
    );
    // 3.3 N at one link is 0.44 N·m.
    let most = f64::from(hello.dac_max) * f64::from(hello.micro_nm_per_count) * 1e-6;
    assert!((most - 0.440).abs() < 0.001, "{most}");
}

#[test]
fn homing_needs_the_dock_and_zeroes_the_counts() {
    let mut rig = Rig::new();
    let before = rig.ticks(200);
    assert_eq!(before.encoders, DOCKED.encoders);
    rig.sensors.switches = 0;
    rig.tell(HostMessage::Home);
    let frame = rig.tick();
    assert_eq!((frame.drive, frame.refused), (DriveState::Unhomed, 1));
    rig.sensors = DOCKED;
    rig.tell(HostMessage::Home);
    let frame = rig.tick();
    assert_eq!((frame.drive, frame.encoders), (DriveState::Homed, [0; 3]));
    rig.sensors.encoders = [11, -18, 27];
    assert_eq!(rig.tick().encoders, [1, 2, -3]);
}

#[test]
fn arming_needs_the_nonce_in_time_and_once() {
    let mut rig = Rig::new();
    assert_eq!(rig.tell(HostMessage::Arm), None, "armed while booting");
    rig.ticks(200);
    rig.tell(HostMessage::Home);
    let first = rig.nonce();
    rig.tell(HostMessage::ArmConfirm {
        nonce: first.wrapping_add(1),
    });
    assert_eq!(rig.tick().drive, DriveState::Homed);
    // The wrong answer used the nonce up.
    rig.tell(HostMessage::ArmConfirm { nonce: first });
    assert_eq!(rig.tick().drive, DriveState::Homed);
    let second = rig.nonce();
    assert_ne!(first, second);
    rig.ticks(501);
    rig.tell(HostMessage::ArmConfirm { nonce: second });
    assert_eq!(rig.tick().drive, DriveState::Homed);
    let third = rig.nonce();
    rig.ticks(500);
    rig.tell(HostMessage::ArmConfirm { nonce: third });
    let frame = rig.tick();
    assert_eq!(frame.drive, DriveState::Armed);
    assert!(rig.drive.motors_on());
    assert_eq!(frame.refused, 4);
}

#[test]
fn without_arming_no_command_moves_a_motor() {
    let mut rig = Rig::new();
    for _ in 0..250 {
        let frame = rig.command([500; 3], true);
        assert_eq!(frame.applied, [0; 3]);
        assert!(!rig.drive.motors_on());
    }
    rig.tell(HostMessage::Home);
    let frame = rig.command([500; 3], true);
    assert_eq!((frame.drive, frame.applied), (DriveState::Homed, [0; 3]));
}

#[test]
fn an_armed_drive_without_commands_goes_back_after_a_second() {
    let mut rig = Rig::armed();
    assert_eq!(rig.ticks(999).drive, DriveState::Armed);
    assert_eq!(rig.tick().drive, DriveState::Homed);
    let mut rig = Rig::armed();
    rig.ticks(900);
    assert_eq!(rig.command([9; 3], false).drive, DriveState::Armed);
    let frame = rig.ticks(999);
    assert_eq!((frame.drive, frame.applied), (DriveState::Armed, [0; 3]));
    assert_eq!(rig.tick().drive, DriveState::Homed);
}

#[test]
fn torque_ramps_up_over_50_ms_after_enabling() {
    let mut rig = Rig::armed();
    for ms in 0..=50 {
        let frame = rig.command([1000, -400, 50], true);
        let expected = [20 * ms, -8 * ms, ms];
        assert_eq!(frame.applied, expected, "{ms} ms");
    }
    let frame = rig.command([1000; 3], false);
    assert_eq!((frame.drive, frame.applied), (DriveState::Armed, [0; 3]));
}

#[test]
fn silence_holds_then_ramps_then_trips() {
    let mut rig = Rig::active([300, -150, 15]);
    for age in 1..=30 {
        let frame = rig.tick();
        let (drive, part) = match age {
            1..=2 => (DriveState::Active, 15),
            3..=5 => (DriveState::Hold, 15),
            6..=19 => (DriveState::Hold, 20 - age),
            _ => (DriveState::Tripped, 0),
        };
        assert_eq!(frame.drive, drive, "age {age} ms");
        assert_eq!(frame.applied, [20 * part, -10 * part, part], "age {age} ms");
        assert_eq!(rig.drive.motors_on(), age < 20, "age {age} ms");
        assert_eq!(frame.faults & fault::WATCHDOG != 0, age >= 20);
        assert_eq!(frame.trips, u8::from(age >= 20));
    }
}

#[test]
fn a_command_ends_the_hold_at_once() {
    let mut rig = Rig::active([300; 3]);
    let frame = rig.ticks(12);
    assert_eq!((frame.drive, frame.applied), (DriveState::Hold, [160; 3]));
    let frame = rig.command([300; 3], true);
    assert_eq!((frame.drive, frame.applied), (DriveState::Active, [300; 3]));
    assert_eq!(frame.trips, 0);
}

#[test]
fn a_trip_rearms_by_itself_after_50_healthy_ms_and_ramps() {
    let mut rig = Rig::active([1000; 3]);
    rig.ticks(25);
    let mut tripped_for = 0;
    let mut frame = rig.command([1000; 3], true);
    while frame.drive == DriveState::Tripped {
        assert_eq!(frame.applied, [0; 3]);
        tripped_for += 1;
        frame = rig.command([1000; 3], true);
        assert!(tripped_for < 1000);
    }
    // Healthy from the first command on: the tick 50 ms later re-arms.
    assert_eq!(tripped_for, 50);
    assert_eq!(frame.drive, DriveState::Active);
    for ms in 1..=50 {
        let frame = rig.command([1000; 3], true);
        assert_eq!(frame.applied, [20 * ms; 3], "{ms} ms after re-arming");
    }
}

#[test]
fn a_gap_above_5_ms_starts_the_50_ms_anew() {
    let mut rig = Rig::active([100; 3]);
    rig.ticks(25);
    for _ in 0..49 {
        assert_eq!(rig.command([100; 3], true).drive, DriveState::Tripped);
    }
    // Five milliseconds between two commands are healthy, six are not.
    rig.ticks(5);
    for n in 0..=50 {
        let frame = rig.command([100; 3], true);
        let expected = if n < 50 {
            DriveState::Tripped
        } else {
            DriveState::Active
        };
        assert_eq!(frame.drive, expected, "command {n}");
    }
    rig.ticks(25);
    for _ in 0..46 {
        rig.command([100; 3], true);
    }
    rig.ticks(4);
    assert_eq!(rig.command([100; 3], true).drive, DriveState::Active);
}

#[test]
fn a_tripped_drive_that_is_not_asked_for_torque_rearms_without() {
    let mut rig = Rig::active([100; 3]);
    rig.ticks(25);
    for _ in 0..50 {
        rig.command([100; 3], false);
    }
    let frame = rig.command([100; 3], false);
    assert_eq!((frame.drive, frame.applied), (DriveState::Armed, [0; 3]));
}

#[test]
fn stale_and_repeated_commands_are_refused_across_the_wrap() {
    let mut rig = Rig::active([100; 3]);
    let newest = rig.seq;
    for back in [0, 1, 50] {
        rig.seq = newest - back - 1;
        let frame = rig.command([200; 3], true);
        assert_eq!((frame.ack, frame.applied), (newest, [100; 3]));
    }
    assert_eq!(rig.tick().refused, 3);
    // They do not feed the watchdog either.
    assert_eq!(rig.tick().drive, DriveState::Hold);
    rig.seq = newest;
    rig.command([100; 3], true);
    rig.seq = u16::MAX - 1;
    rig.drive.command = rig.drive.command.map(|(c, at)| {
        (
            CommandFrame {
                seq: u16::MAX - 1,
                ..c
            },
            at,
        )
    });
    assert_eq!(rig.command([101; 3], true).ack, u16::MAX);
    let frame = rig.command([102; 3], true);
    assert_eq!((frame.ack, frame.applied), (1, [102; 3]));
}

#[test]
fn rising_is_slewed_and_falling_is_not() {
    let mut rig = Rig::active([0; 3]);
    let frame = rig.command([2000; 3], true);
    assert_eq!(frame.applied, SLEW_COUNTS_PER_MS);
    assert_ne!(frame.faults & fault::SLEW_LIMIT, 0);
    let frame = rig.command([2000; 3], true);
    assert_eq!(frame.applied, SLEW_COUNTS_PER_MS.map(|rise| 2 * rise));
    let frame = rig.command([100, 0, -50], true);
    assert_eq!(frame.applied, [100, 0, -50]);
    assert_eq!(frame.faults, 0);
    // Through zero: the fall is free, the rise on the other side is not.
    let frame = rig.command([-2000, -2000, 300], true);
    assert_eq!(frame.applied, [-605, -312, 300]);
}

#[test]
fn three_commands_above_the_limit_latch_a_fault() {
    let mut rig = Rig::active([100; 3]);
    for _ in 0..2 {
        let frame = rig.command([0, DAC_MAX + 1, 0], true);
        assert_eq!(frame.applied, [100; 3], "applied or dropped on a refusal");
        assert_ne!(frame.faults & fault::TORQUE_LIMIT, 0);
    }
    rig.command([100; 3], true);
    for _ in 0..2 {
        rig.command([i16::MIN, 0, 0], true);
    }
    assert_eq!(rig.drive.drive(), DriveState::Active, "not three in a row");
    let frame = rig.command([i16::MAX, 0, 0], true);
    assert_eq!((frame.drive, frame.applied), (DriveState::Fault, [0; 3]));
    assert!(!rig.drive.motors_on());
    for _ in 0..200 {
        let frame = rig.command([100; 3], true);
        assert_eq!((frame.drive, frame.applied), (DriveState::Fault, [0; 3]));
        assert_ne!(frame.faults & fault::TORQUE_LIMIT, 0);
    }
    rig.tell(HostMessage::Disarm);
    let frame = rig.tick();
    assert_eq!((frame.drive, frame.faults), (DriveState::Homed, 0));
}

#[test]
fn heat_latches_and_returns_while_it_lasts() {
    let mut rig = Rig::active([100; 3]);
    rig.sensors.temperature[1] = TEMPERATURE_LIMIT_C;
    let frame = rig.command([100; 3], true);
    assert_eq!(frame.drive, DriveState::Fault);
    assert_eq!(frame.faults, fault::OVER_TEMPERATURE);
    rig.tell(HostMessage::Disarm);
    assert_eq!(rig.tick().drive, DriveState::Fault);
    rig.sensors.temperature[1] = TEMPERATURE_LIMIT_C - 1;
    assert_eq!(rig.tick().drive, DriveState::Fault, "not latched");
    rig.tell(HostMessage::Disarm);
    assert_eq!(rig.tick().drive, DriveState::Homed);
}

#[test]
fn a_fast_hit_on_a_stop_is_a_fault_and_a_slow_one_is_said() {
    let mut rig = Rig::active([100; 3]);
    rig.sensors.at_stop[2] = true;
    rig.sensors.encoders[2] += STOP_SPEED_COUNTS_PER_MS.cast_signed();
    let frame = rig.command([100; 3], true);
    assert_eq!(
        (frame.drive, frame.faults),
        (DriveState::Active, fault::JOINT_LIMIT)
    );
    rig.sensors.encoders[2] -= STOP_SPEED_COUNTS_PER_MS.cast_signed() + 1;
    assert_eq!(rig.command([100; 3], true).drive, DriveState::Fault);
}

#[test]
fn a_new_host_starts_from_homed_and_counts_anew() {
    let mut rig = Rig::active([100; 3]);
    rig.tell(HostMessage::HelloRequest {
        version: DEVICE_VERSION,
        schema: DEVICE_SCHEMA,
    });
    let frame = rig.tick();
    assert_eq!(
        (frame.drive, frame.applied, frame.ack),
        (DriveState::Homed, [0; 3], 0)
    );
    rig.seq = 0;
    assert_eq!(rig.command([0; 3], true).ack, 1);
}

#[test]
fn disarm_is_motors_off_in_the_same_tick() {
    let mut rig = Rig::active([100; 3]);
    rig.tell(HostMessage::Disarm);
    assert_eq!(rig.drive.dac(), [0; 3]);
    assert!(!rig.drive.motors_on());
    assert_eq!(rig.tick().drive, DriveState::Homed);
}

#[test]
fn the_emergency_stop_and_a_failed_self_test_latch() {
    for (open, failed, bit) in [
        (true, false, fault::E_STOP),
        (false, true, fault::SELF_TEST),
    ] {
        let mut rig = Rig::active([100; 3]);
        (rig.sensors.e_stop, rig.sensors.self_test_failed) = (open, failed);
        let frame = rig.command([100; 3], true);
        assert_eq!((frame.drive, frame.faults), (DriveState::Fault, bit));
        assert!(!rig.drive.motors_on());
        rig.tell(HostMessage::Disarm);
        assert_eq!(rig.tick().drive, DriveState::Fault, "the cause is there");
        rig.sensors = DOCKED;
        assert_eq!(rig.command([100; 3], true).drive, DriveState::Fault);
        rig.tell(HostMessage::Disarm);
        assert_eq!(rig.tick().drive, DriveState::Homed);
    }
}

#[test]
fn a_clock_that_runs_backwards_is_a_fault() {
    let mut rig = Rig::active([100; 3]);
    rig.ms -= 30;
    let frame = rig.tick();
    assert_eq!(
        (frame.drive, frame.faults),
        (DriveState::Fault, fault::SELF_TEST)
    );
}

#[test]
fn a_torque_that_answers_an_old_state_is_refused_and_a_zero_is_not() {
    let mut rig = Rig::active([100; 3]);
    let answer = |rig: &mut Rig, behind: u16, torque| {
        rig.seq += 1;
        let command = CommandFrame {
            seq: rig.seq,
            state_seq: rig.drive.frame_seq.wrapping_sub(behind),
            torque,
            enable: true,
        };
        rig.tell(HostMessage::Command(command));
        rig.tick()
    };
    let frame = answer(&mut rig, 19, [101; 3]);
    assert_eq!((frame.applied, frame.refused), ([101; 3], 0));
    let frame = answer(&mut rig, 20, [102; 3]);
    assert_eq!((frame.applied, frame.refused), ([101; 3], 1));
    let frame = answer(&mut rig, 5000, [0; 3]);
    assert_eq!((frame.applied, frame.refused), ([0; 3], 1));
}
