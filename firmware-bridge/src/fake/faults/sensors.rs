//! Faults of what the device reads.

use super::catalogue::Fault;
use crate::fake::random::Random;
use osteon_protocol::device::switch;
use osteon_protocol::firmware::Sensors;

/// Contacts bounce for so long, ms.
const BOUNCE_MS: u64 = 8;
/// What a winding's sensor reads when it is too hot, °C.
const HOT_C: i8 = 125;

/// A fault of the sensors that has begun.
#[derive(Debug, Clone)]
pub struct SensorFault {
    fault: Fault,
    random: Random,
    // ms since it began; nothing before the first sample
    age_ms: u64,
    joint: usize,
    counts: i32,
    // readings when it began
    first: Option<Sensors>,
}

impl SensorFault {
    /// Begins with the next sample.
    pub fn new(fault: Fault, seed: u64) -> Self {
        let mut random = Random::new(seed);
        let joint = random.joint();
        let size = match fault {
            Fault::EncoderGlitch => random.within(50, 2000),
            _ => random.within(3, 40),
        };
        let counts = if random.below(2) == 0 { size } else { -size };
        Self {
            fault,
            random,
            age_ms: 0,
            joint,
            counts,
            first: None,
        }
    }

    /// Falsifies the readings of the next millisecond.
    pub fn disturb(&mut self, sensors: &mut Sensors) {
        let first = *self.first.get_or_insert(*sensors);
        let age = self.age_ms;
        self.age_ms += 1;
        let lasts = u64::from(self.fault.entry().lasts_ms);
        let over = lasts > 0 && age >= lasts;
        let encoder = &mut sensors.encoders[self.joint];
        match self.fault {
            Fault::EncoderGlitch if age == 0 => *encoder = encoder.wrapping_add(self.counts),
            Fault::EncoderJump => *encoder = encoder.wrapping_add(self.counts),
            Fault::EncoderStuck if !over => *encoder = first.encoders[self.joint],
            Fault::PotDropout if !over => {
                // the wiper has lost its track: an end of the range
                sensors.gimbal[self.joint] = if self.counts > 0 { 7000 } else { -7000 };
            }
            Fault::ButtonBounce => self.bounce(age, lasts, sensors),
            Fault::DockSwitch if !over => sensors.switches |= switch::DOCKED,
            Fault::OverTemperature => sensors.temperature[self.joint] = HOT_C,
            Fault::EStop => sensors.e_stop = true,
            Fault::SelfTest => sensors.self_test_failed = true,
            _ => {}
        }
    }

    fn bounce(&mut self, age: u64, lasts: u64, sensors: &mut Sensors) {
        let bouncing = age < BOUNCE_MS || (lasts..lasts + BOUNCE_MS).contains(&age);
        let pressed = if bouncing {
            self.random.below(2) == 0
        } else {
            age < lasts
        };
        if pressed {
            sensors.switches |= switch::BUTTON_1;
        }
    }
}
