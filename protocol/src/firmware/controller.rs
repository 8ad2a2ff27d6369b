//! A drive on its cable: bytes in, frames out.

use super::{DriveConfig, Firmware, Sensors};
use crate::device::{DeviceMessage, HostMessage, StateFrame};
use crate::frame::{FrameReader, MAX_FRAME, encode};

/// A [`Firmware`] and the framing of its cable.
///
/// ```
/// use osteon_protocol::firmware::{Controller, DriveConfig, Sensors};
/// use osteon_protocol::frame::MAX_FRAME;
///
/// let mut controller = Controller::new(DriveConfig::omni(7), 0x5eed);
/// let (mut out, sensors) = ([0; MAX_FRAME], Sensors::default());
/// // the main loop of a firmware, once a millisecond
/// let now_micros = 1000;
/// for byte in [0x00, 0x17] {
///     let _to_send: &[u8] = controller.push(now_micros, byte, &sensors, &mut out);
/// }
/// let (_state, frame) = controller.tick(now_micros, &sensors, &mut out);
/// assert_eq!(frame.len(), 49);
/// assert_eq!(controller.drive().dac(), [0; 3]);
/// ```
#[derive(Debug, Clone)]
pub struct Controller {
    drive: Firmware,
    reader: FrameReader,
}

impl Controller {
    /// A device at power-up, at time 0 of its clock. `seed`: as in [`Firmware::new`].
    pub const fn new(config: DriveConfig, seed: u64) -> Self {
        Self {
            drive: Firmware::new(config, seed),
            reader: FrameReader::new(),
        }
    }

    /// The drive.
    pub const fn drive(&self) -> &Firmware {
        &self.drive
    }

    /// Takes one byte of the cable at time `now` (µs). What is returned is to be sent; it is empty where
    /// there is no answer.
    pub fn push<'a>(
        &mut self,
        now: u64,
        byte: u8,
        sensors: &Sensors,
        out: &'a mut [u8; MAX_FRAME],
    ) -> &'a [u8] {
        match self.reader.push::<HostMessage>(byte) {
            Some(Ok(message)) => match self.drive.receive(now, message, sensors) {
                Some(answer) => framed(&answer, out),
                None => &[],
            },
            Some(Err(_)) => {
                self.drive.count_bad_frame();
                &[]
            }
            None => &[],
        }
    }

    /// Takes one message that came some other way than as bytes of a frame.
    pub fn receive(
        &mut self,
        now: u64,
        message: HostMessage,
        sensors: &Sensors,
    ) -> Option<DeviceMessage> {
        self.drive.receive(now, message, sensors)
    }

    /// A message came some other way, and was none.
    pub fn count_bad_frame(&mut self) {
        self.drive.count_bad_frame();
    }

    /// One period at time `now` (µs): the state, and its frame to be sent. The motors follow
    /// [`Firmware::dac`] and [`Firmware::motors_on`] from here on.
    pub fn tick<'a>(
        &mut self,
        now: u64,
        sensors: &Sensors,
        out: &'a mut [u8; MAX_FRAME],
    ) -> (StateFrame, &'a [u8]) {
        let state = self.drive.tick(now, sensors);
        (state, framed(&DeviceMessage::State(state), out))
    }
}

// Every message of the device fits a frame; one that did not would be lost like any other.
fn framed<'a>(message: &DeviceMessage, out: &'a mut [u8; MAX_FRAME]) -> &'a [u8] {
    encode(message, out).unwrap_or(&[])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::{DriveState, switch};

    const DOCKED: Sensors = Sensors {
        encoders: [10, -20, 30],
        gimbal: [0; 3],
        switches: switch::DOCKED,
        at_stop: [false; 3],
        temperature: [25; 3],
        e_stop: false,
        self_test_failed: false,
    };

    #[test]
    fn bytes_make_the_same_session_as_messages() {
        let mut controller = Controller::new(DriveConfig::omni(7), 99);
        let mut out = [0; MAX_FRAME];
        let mut send = |controller: &mut Controller, now, message: &HostMessage| {
            let mut bytes = [0; MAX_FRAME];
            let mut reader = FrameReader::new();
            let mut answer = None;
            for &byte in encode(message, &mut bytes).unwrap() {
                for &back in controller.push(now, byte, &DOCKED, &mut out) {
                    answer = reader.push::<DeviceMessage>(back).or(answer);
                }
            }
            answer.map(Result::unwrap)
        };
        let mut buffer = [0; MAX_FRAME];
        for ms in 1..=200 {
            controller.tick(ms * 1000, &DOCKED, &mut buffer);
        }
        assert_eq!(send(&mut controller, 201_000, &HostMessage::Home), None);
        let Some(DeviceMessage::Challenge { nonce }) =
            send(&mut controller, 201_000, &HostMessage::Arm)
        else {
            panic!("no challenge");
        };
        send(&mut controller, 201_000, &HostMessage::ArmConfirm { nonce });
        // half a frame, and its end later: one refusal, nothing done
        for byte in [3, 1, 0] {
            assert!(
                controller
                    .push(201_000, byte, &DOCKED, &mut buffer)
                    .is_empty()
            );
        }
        let (state, frame) = controller.tick(201_000, &DOCKED, &mut buffer);
        assert_eq!((state.drive, state.crc_errors), (DriveState::Armed, 1));
        let mut reader = FrameReader::new();
        let read: Vec<_> = frame.iter().filter_map(|&b| reader.push(b)).collect();
        assert_eq!(read, [Ok(DeviceMessage::State(state))]);
    }
}
