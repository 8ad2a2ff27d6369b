use super::*;
use crate::fake::stroke::Segment;
use osteon_protocol::device::CommandFrame;
use osteon_protocol::firmware::limits::{COUNTS_PER_REV, GIMBAL_COUNTS_PER_REV};

const DOCKED_AT: DVec3 = DVec3::new(0.0, -70.647, -86.729);

fn stroke() -> Stroke {
    let segment = |name: &str, goal: DVec3, speed: f64| Segment {
        name: name.to_owned(),
        goal_mm: goal.to_array(),
        axis: [0.1, 0.3, 0.9],
        speed_mm_s: speed,
        max_push_n: 1.5,
        press: None,
        dwell_s: 0.0,
        timeout_s: 8.0,
    };
    Stroke {
        segments: vec![
            segment("out", DOCKED_AT + DVec3::new(10.0, 20.0, 30.0), 40.0),
            segment("in", DOCKED_AT + DVec3::new(10.0, 20.0, 10.0), 5.0),
        ],
    }
}

/// A host on the same virtual clock whose command answers the state of the tick before, as over a
/// cable: `force` makes newtons at the stylus out of the state.
struct Host {
    device: Device,
    seq: u16,
    last: StateFrame,
}

impl Host {
    fn new(stroke: Stroke, seed: u64) -> Self {
        let mut device = Device::new(stroke, seed);
        device.simulate();
        let last = device.tick();
        let mut host = Self {
            device,
            seq: 0,
            last,
        };
        for _ in 0..210 {
            host.tick(&[]);
        }
        host.tick(&[HostMessage::Home]);
        host.device.simulate();
        let Some(DeviceMessage::Challenge { nonce }) = host.device.receive(HostMessage::Arm) else {
            panic!("no challenge");
        };
        host.device.tick();
        host.tick(&[HostMessage::ArmConfirm { nonce }]);
        assert_eq!(host.last.drive, DriveState::Armed);
        host
    }

    fn tick(&mut self, messages: &[HostMessage]) {
        self.device.simulate();
        for message in messages {
            self.device.receive(*message);
        }
        self.last = self.device.tick();
    }

    fn joints(&self) -> DVec3 {
        omni::angles_from_counts(self.last.encoders, COUNTS_PER_REV)
    }

    #[expect(clippy::cast_possible_truncation, reason = "the cast saturates")]
    fn servo(&mut self, force: impl Fn(DVec3) -> DVec3) {
        // As at a real start: no force before the stylus has been out.
        let free = self.device.hand().segment() < 1;
        let joints = self.joints();
        let force = if free {
            DVec3::ZERO
        } else {
            force(omni::forward(joints))
        };
        let torque = omni::torque_from_force(joints, force);
        self.seq += 1;
        let command = CommandFrame {
            seq: self.seq,
            state_seq: self.last.seq,
            torque: torque.to_array().map(|t| (t / 0.215).round() as i16),
            enable: true,
        };
        self.tick(&[HostMessage::Command(command)]);
    }
}

#[test]
fn the_host_sees_the_true_pose_within_a_count_for_every_seed() {
    for seed in [1, 2, 77, u64::MAX] {
        let mut host = Host::new(stroke(), seed);
        assert_ne!(host.last.switches & switch::DOCKED, 0);
        let (mut squares, mut worst, mut samples) = (0.0, 0.0_f64, 0);
        let mut ticks = 0;
        while !host.device.hand().done() && ticks < 12_000 {
            host.servo(|_| DVec3::ZERO);
            let truth = host.device.truth(&host.last);
            let error = (omni::forward(host.joints()) - truth.gimbal_mm).length();
            squares += error * error;
            worst = worst.max(error);
            samples += 1;
            ticks += 1;
        }
        assert!(host.device.hand().done(), "seed {seed}");
        assert_eq!(host.last.switches & switch::DOCKED, 0);
        // Half a count of each joint: 0.042 mm at the longest lever (0.2 m), 0.028 at the others.
        let rms = (squares / f64::from(samples)).sqrt();
        assert!(rms < 0.05 && worst < 0.1, "rms {rms}, worst {worst}");
        let gimbal = omni::gimbal_from_counts(host.last.gimbal, GIMBAL_COUNTS_PER_REV);
        let axis = omni::stylus(host.joints(), gimbal).vector(DVec3::Z);
        let wanted = DVec3::new(0.1, 0.3, 0.9).try_normalize().unwrap();
        assert!(axis.distance(wanted) < 0.007, "{axis}");
    }
}

#[test]
fn a_virtual_wall_holds_the_hand_and_the_truth_balances() {
    // Wall of 0.5 N/mm at 5 mm from the goal of "in": 1.5 N of push end 3 mm deep.
    let wall_z = DOCKED_AT.z + 15.0;
    let mut host = Host::new(stroke(), 3);
    for _ in 0..6000 {
        host.servo(|p| DVec3::Z * (0.5 * (wall_z - p.z)).max(0.0));
    }
    let truth = host.device.truth(&host.last);
    assert_eq!(truth.segment, 1);
    assert!(
        (wall_z - truth.gimbal_mm.z - 3.0).abs() < 0.3,
        "{}",
        truth.gimbal_mm
    );
    let joints = host.device.plant().joints();
    let shown = omni::jacobian(joints).transpose().inverse() * truth.torque_nmm;
    // At rest hand and motors balance but for the remaining weight (0.04 N).
    assert!(
        (shown + truth.hand_n).length() < 0.1,
        "{shown} {}",
        truth.hand_n
    );
    assert!((shown.z - 1.5).abs() < 0.1, "{shown}");
}

#[test]
fn silence_is_zero_torque_at_the_plant_within_20_ms_and_the_hand_lets_go() {
    let wall_z = DOCKED_AT.z + 15.0;
    let mut host = Host::new(stroke(), 4);
    for _ in 0..6000 {
        host.servo(|p| DVec3::Z * (0.5 * (wall_z - p.z)).max(0.0));
    }
    assert!(host.device.truth(&host.last).torque_nmm.length() > 100.0);
    for age in 1..=20 {
        assert!(host.device.truth(&host.last).motors_on, "age {age}");
        host.tick(&[]);
    }
    let truth = host.device.truth(&host.last);
    assert_eq!(truth.torque_nmm, DVec3::ZERO);
    assert_eq!((truth.drive, truth.motors_on), (DriveState::Tripped, false));
    for _ in 0..500 {
        host.tick(&[]);
    }
    let truth = host.device.truth(&host.last);
    assert!(truth.hand_n.length() < 0.15, "{}", truth.hand_n);
}

#[test]
fn the_same_seed_and_commands_give_the_same_frames() {
    let run = || {
        let mut host = Host::new(stroke(), 9);
        let mut frames = Vec::new();
        for _ in 0..1500 {
            host.servo(|p| p * 1e-3);
            frames.push(host.last);
        }
        frames
    };
    assert_eq!(run(), run());
}
