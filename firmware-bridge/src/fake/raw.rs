//! The simulated device's state as the stock Omni's own payload ([`osteon_protocol::omni_raw`]): another encoding
//! of the same state, with potentiometers in the wrist.

use super::pots::Pots;
use osteon_protocol::device::{StateFrame, switch};
use osteon_protocol::omni_raw::RawState;
use osteon_sim_core::omni;

/// Makes payloads of states.
#[derive(Debug, Clone)]
pub struct RawStream {
    pots: Pots,
    gimbal_counts_per_rev: u16,
    message: u32,
}

impl RawStream {
    /// A device with the potentiometers of this seed, whose states have so many gimbal counts a revolution.
    pub fn new(seed: u64, gimbal_counts_per_rev: u16) -> Self {
        Self {
            pots: Pots::new(seed),
            gimbal_counts_per_rev,
            message: 0,
        }
    }

    /// The payload of the same moment as `state`. `raw_encoders`: the counters as they stand, without the
    /// reference that homing gave them; they wrap at 16 bits, the shoulder's runs the other way.
    pub fn payload(&mut self, state: &StateFrame, raw_encoders: [i32; 3]) -> RawState {
        let angles = omni::gimbal_from_counts(state.gimbal, self.gimbal_counts_per_rev);
        let (pots, inverse_pots) = self.pots.read(angles);
        self.message = self.message.wrapping_add(1);
        let [e0, e1, e2] = raw_encoders;
        #[expect(
            clippy::cast_possible_truncation,
            reason = "counters of 16 and 8 bits that wrap"
        )]
        RawState {
            encoders: [e0, e1.wrapping_neg(), e2].map(|n| n as i16),
            pots,
            inverse_pots,
            packet: self.message as u8,
            button_1: state.switches & switch::BUTTON_1 != 0,
            button_2: state.switches & switch::BUTTON_2 != 0,
            docked: state.switches & switch::DOCKED != 0,
            message: self.message,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::device::{Device, DeviceSetup};
    use super::super::{Segment, Stroke};
    use super::*;
    use glam::DVec3;
    use osteon_protocol::device::{CommandFrame, DEVICE_SCHEMA, DeviceMessage, HostMessage};
    use osteon_protocol::frame::{FrameReader, MAX_FRAME};
    use osteon_sim_core::pots::PotWrist;

    /// What a bridge to a stock Omni would do: unwrap, take the dock's counts away, divide the tracks.
    struct Bridge {
        last: Option<[i16; 3]>,
        counts: [i32; 3],
        dock: [i32; 3],
        wrist: PotWrist,
    }

    impl Bridge {
        fn take(&mut self, raw: &RawState) -> ([i32; 3], DVec3) {
            let [e0, e1, e2] = raw.encoders;
            let now = [e0, e1.wrapping_neg(), e2];
            let before = self.last.replace(now).unwrap_or(now);
            for joint in 0..3 {
                self.counts[joint] += i32::from(now[joint].wrapping_sub(before[joint]));
            }
            if raw.docked {
                self.dock = self.counts;
            }
            let counts = [0, 1, 2].map(|n| self.counts[n] - self.dock[n]);
            (counts, self.wrist.angles(raw.pots, raw.inverse_pots))
        }
    }

    fn stroke() -> Stroke {
        let goals = [[0.0, -20.0, 40.0], [50.0, 30.0, 20.0], [-60.0, 40.0, -10.0]];
        let segments = goals.map(|goal_mm| Segment {
            name: "on".to_owned(),
            goal_mm,
            axis: [0.2, -0.3, 1.0],
            speed_mm_s: 300.0,
            max_push_n: 4.0,
            press: Some(1),
            dwell_s: 0.1,
            timeout_s: 3.0,
        });
        Stroke {
            segments: segments.to_vec(),
        }
    }

    /// A whole session, both encodings by their bytes: joint angles and switches are equal count for count, the
    /// wrist as exactly as its potentiometers are, calibrated.
    #[test]
    fn both_encodings_give_the_same_state() {
        let setup = DeviceSetup {
            // the 16 bits wrap on the way
            power_up: [32_760, -32_760, 32_000],
            ..DeviceSetup::new(stroke(), 11)
        };
        let mut device = Device::build(setup);
        let hello = device.firmware().config().hello;
        let mut stream = RawStream::new(5, hello.gimbal_counts_per_rev);
        let wrist = Pots::new(5).calibration();
        let mut bridge = Bridge {
            last: None,
            counts: [0; 3],
            dock: [0; 3],
            wrist,
        };
        let mut reader = FrameReader::new();
        let (mut nonce, mut out) = (None, [0; MAX_FRAME]);
        let (mut moved, mut pressed, mut worst) = (0, 0, 0.0_f64);
        for n in 0..6000_u16 {
            device.simulate();
            let message = match (n, nonce) {
                (0..1000, _) => HostMessage::HelloRequest {
                    version: 1,
                    schema: DEVICE_SCHEMA,
                },
                (1000, _) => HostMessage::Home,
                (1001, _) => HostMessage::Arm,
                (1002, Some(nonce)) => HostMessage::ArmConfirm { nonce },
                _ => HostMessage::Command(CommandFrame {
                    seq: n,
                    state_seq: n,
                    torque: [0; 3],
                    enable: true,
                }),
            };
            if let Some(DeviceMessage::Challenge { nonce: new }) = device.receive(message) {
                nonce = Some(new);
            }
            let (state, frame) = device.tick_frame(&mut out);
            let open = frame.iter().find_map(|&b| reader.push::<DeviceMessage>(b));
            assert_eq!(open, Some(Ok(DeviceMessage::State(state))));
            let raw = stream.payload(&state, device.plant().encoders()).encode();
            let raw = RawState::decode(&raw).unwrap();
            let (counts, angles) = bridge.take(&raw);
            assert_eq!(raw.button_1, state.switches & switch::BUTTON_1 != 0);
            assert_eq!(raw.docked, state.switches & switch::DOCKED != 0);
            if n > 1001 {
                assert_eq!(counts, state.encoders, "tick {n}");
            }
            let told = omni::gimbal_from_counts(state.gimbal, hello.gimbal_counts_per_rev);
            worst = worst.max((angles - told).abs().max_element());
            moved = moved.max(state.encoders[0].abs());
            pressed += u32::from(raw.button_1);
        }
        assert!(moved > 1000 && pressed > 100, "{moved} {pressed}");
        // 32 of 65,536 parts are noise at either end, the table's lines lie 0.002 of a track beside the curve
        assert!(worst < 0.02, "{worst} rad");
    }
}
