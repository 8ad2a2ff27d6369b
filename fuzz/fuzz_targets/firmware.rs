//! The device's firmware under any bytes: no panic, and no torque while the motors are off or beyond the limit.
//!
//! The input's first byte says how many bytes come in each millisecond. A byte of 0xFF in the place of a message
//! makes a sound one, so that the fuzzer gets past the checksum.
#![no_main]

use libfuzzer_sys::fuzz_target;
use osteon_protocol::device::{CommandFrame, DEVICE_SCHEMA, DEVICE_VERSION, DeviceMessage, HostMessage, switch};
use osteon_protocol::firmware::{Controller, DriveConfig, Sensors};
use osteon_protocol::frame::MAX_FRAME;

fuzz_target!(|bytes: &[u8]| {
    let Some((&pace, bytes)) = bytes.split_first() else {
        return;
    };
    let config = DriveConfig::omni(1);
    let most = config.hello.dac_max;
    let mut controller = Controller::new(config, 1);
    let mut sensors = Sensors {
        switches: switch::DOCKED,
        ..Sensors::default()
    };
    let mut out = [0; MAX_FRAME];
    let (mut now, mut nonce, mut seq) = (0, 0, 0_u16);
    for chunk in bytes.chunks(usize::from(pace % 16) + 1) {
        now += 1000;
        for pair in chunk.windows(2) {
            match *pair {
                [0xFF, kind] => {
                    let message = sound(kind, nonce, &mut seq);
                    if let Some(DeviceMessage::Challenge { nonce: new }) = controller.receive(now, message, &sensors) {
                        nonce = new;
                    }
                }
                [byte, _] => drop(controller.push(now, byte, &sensors, &mut out)),
                _ => {}
            }
        }
        sensors.e_stop = chunk.first() == Some(&0xEE);
        sensors.encoders[0] = sensors.encoders[0].wrapping_add(i32::from(chunk[0] % 4));
        controller.tick(now, &sensors, &mut out);
        let drive = controller.drive();
        for torque in drive.dac() {
            assert!(torque.abs() <= most);
            assert!(drive.motors_on() || torque == 0);
        }
        assert!(!(sensors.e_stop && drive.motors_on()));
    }
});

fn sound(kind: u8, nonce: u32, seq: &mut u16) -> HostMessage {
    match kind % 8 {
        0 => HostMessage::HelloRequest {
            version: DEVICE_VERSION,
            schema: DEVICE_SCHEMA,
        },
        1 => HostMessage::Home,
        2 => HostMessage::Arm,
        3 => HostMessage::ArmConfirm { nonce },
        4 => HostMessage::Disarm,
        _ => {
            *seq = seq.wrapping_add(u16::from(kind >> 5)).max(1);
            HostMessage::Command(CommandFrame {
                seq: *seq,
                state_seq: 0,
                torque: [i16::from(kind) * 10, -i16::from(kind) * 10, 2100],
                enable: kind & 16 == 0,
            })
        }
    }
}
