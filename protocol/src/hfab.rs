//! Lines of the open Phantom-class controllers (hfab: `WoodenHaptics` and re-equipped vintage arms).
//!
//! ```text
//! device to host   [model,e0,e1,e2,e3,e4,e5,error]\n     one for each command
//! host to device   [mA0,mA1,mA2]\n
//! ```
//! Decimal numbers, no checksum, no sequence number: a damaged digit is another valid number. The
//! reader here is stricter than the firmware's own (no blanks, no `+`, no leading zeros, numbers of at
//! most ten digits, nothing between `]` and the line's end), which is all the integrity that the format
//! allows; what remains must be caught by plausibility. Source of the format:
//! forsslund/hfabapi `hfab_protocol.h`, forsslund/woodenhaptics `woody_teensy_mini.ino`.

/// Most bytes of a line in either direction, its end included.
pub const MAX_LINE: usize = 1 + 8 * 11 + 7 + 2;

/// Largest current that the firmware takes, mA; it reads a larger one as zero.
pub const MAX_MILLIAMPS: i16 = 6000;

/// Silence after which the firmware lets the amplifiers go, ms. Until then the last current flows.
pub const WATCHDOG_MS: u32 = 100;

/// Bits of [`HfabState::error`].
pub mod error {
    /// Gimbal sensors 1 to 3 did not answer (one bit each).
    pub const GIMBAL: i32 = 1 | 2 | 4;
    /// The command had bytes behind it: two commands were under way. It was not applied.
    pub const TRAILING: i32 = 8;
    /// The command was too long. It was not applied.
    pub const TOO_LONG: i32 = 128;
    /// The command had an end and no beginning. It was not applied.
    pub const NO_START: i32 = 256;
    /// The command had a wrong count of numbers. It was not applied.
    pub const COUNT: i32 = 512;
    /// The command's numbers could not be read. It was not applied.
    pub const PARSE: i32 = 1024;
    /// Bits that say that the command was not applied (the counts of the line are then old ones).
    pub const REFUSED: i32 = TRAILING | TOO_LONG | NO_START | COUNT | PARSE;
}

/// Why a line is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HfabError {
    /// A byte that has no place there.
    Byte,
    /// Too few or too many numbers.
    Count,
    /// A number out of 32 bits, of too many digits, or without a digit.
    Number,
}

impl core::fmt::Display for HfabError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Byte => "a byte that has no place in a line",
            Self::Count => "a wrong count of numbers",
            Self::Number => "a number that is none",
        })
    }
}

impl core::error::Error for HfabError {}

/// What the device says.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct HfabState {
    /// 1 = Polhem, 2 = vintage Phantom, 3 = `WoodenHaptics`.
    pub model: i32,
    /// Motor encoders 0 to 2 and gimbal encoders 3 to 5, counts from the calibration pose.
    pub encoders: [i32; 6],
    /// [`error`] bits.
    pub error: i32,
}

impl HfabState {
    /// From the numbers of a line.
    pub const fn new(numbers: [i32; 8]) -> Self {
        let [model, e0, e1, e2, e3, e4, e5, error] = numbers;
        Self {
            model,
            encoders: [e0, e1, e2, e3, e4, e5],
            error,
        }
    }

    /// The numbers of its line.
    pub const fn numbers(&self) -> [i32; 8] {
        let [e0, e1, e2, e3, e4, e5] = self.encoders;
        [self.model, e0, e1, e2, e3, e4, e5, self.error]
    }
}

/// Cuts a byte stream into lines of `N` numbers. Holds one line, allocates nothing, and falls into step
/// at the next `[`.
#[derive(Debug, Clone)]
pub struct LineReader<const N: usize> {
    numbers: [i32; N],
    at: Place,
    // of the number that is being read
    index: usize,
    value: i64,
    digits: u8,
    negative: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Before a `[`: blank line ends are skipped, anything else is counted once.
    Outside { clean: bool },
    /// Between the brackets.
    Inside,
    /// After the `]`: the line's end must follow.
    Closed,
}

impl<const N: usize> LineReader<N> {
    /// A reader at a line's beginning.
    pub const fn new() -> Self {
        Self {
            numbers: [0; N],
            at: Place::Outside { clean: true },
            index: 0,
            value: 0,
            digits: 0,
            negative: false,
        }
    }

    /// Takes one byte. `Some` at the end of a line: its numbers, or why it is refused.
    pub fn push(&mut self, byte: u8) -> Option<Result<[i32; N], HfabError>> {
        match (self.at, byte) {
            (Place::Closed, b'\n') => {
                self.at = Place::Outside { clean: true };
                Some(Ok(self.numbers))
            }
            (Place::Closed, b'\r') | (Place::Outside { .. }, b'\n' | b'\r' | 0) => None,
            (place, b'[') => {
                *self = Self {
                    at: Place::Inside,
                    ..Self::new()
                };
                matches!(place, Place::Inside | Place::Closed).then_some(Err(HfabError::Byte))
            }
            (Place::Outside { clean }, _) => {
                self.at = Place::Outside { clean: false };
                clean.then_some(Err(HfabError::Byte))
            }
            (Place::Closed, _) => Some(self.refuse(HfabError::Byte)),
            (Place::Inside, byte) => match self.inside(byte) {
                Ok(()) => None,
                Err(error) => Some(self.refuse(error)),
            },
        }
    }

    fn refuse(&mut self, error: HfabError) -> Result<[i32; N], HfabError> {
        self.at = Place::Outside { clean: false };
        Err(error)
    }

    fn inside(&mut self, byte: u8) -> Result<(), HfabError> {
        match byte {
            b'-' if self.digits == 0 && !self.negative => self.negative = true,
            b'0'..=b'9' => {
                let leading_zero = self.digits == 1 && self.value == 0;
                if leading_zero || self.digits == 10 {
                    return Err(HfabError::Number);
                }
                self.value = self.value * 10 + i64::from(byte - b'0');
                self.digits += 1;
            }
            b',' => self.close_number()?,
            b']' => {
                self.close_number()?;
                if self.index != N {
                    return Err(HfabError::Count);
                }
                self.at = Place::Closed;
            }
            _ => return Err(HfabError::Byte),
        }
        Ok(())
    }

    fn close_number(&mut self) -> Result<(), HfabError> {
        // "-0" is what no device writes
        if self.digits == 0 || (self.negative && self.value == 0) {
            return Err(HfabError::Number);
        }
        let value = if self.negative {
            -self.value
        } else {
            self.value
        };
        let slot = self.numbers.get_mut(self.index).ok_or(HfabError::Count)?;
        *slot = i32::try_from(value).or(Err(HfabError::Number))?;
        self.index += 1;
        (self.value, self.digits, self.negative) = (0, 0, false);
        Ok(())
    }
}

impl<const N: usize> Default for LineReader<N> {
    fn default() -> Self {
        Self::new()
    }
}

/// Writes a line of numbers and returns its bytes. At most eight numbers fit; more are left out.
pub fn write_line<'a>(numbers: &[i32], out: &'a mut [u8; MAX_LINE]) -> &'a [u8] {
    let mut length = 0;
    let mut put = |byte: u8| {
        if let Some(slot) = out.get_mut(length) {
            *slot = byte;
            length += 1;
        }
    };
    put(b'[');
    for (n, &number) in numbers.iter().take(8).enumerate() {
        if n > 0 {
            put(b',');
        }
        if number < 0 {
            put(b'-');
        }
        let magnitude = number.unsigned_abs();
        let mut power = 1_000_000_000_u32;
        while power > 1 && magnitude / power == 0 {
            power /= 10;
        }
        while power > 0 {
            let digit = (magnitude / power % 10) as u8;
            put(b'0' + digit);
            power /= 10;
        }
    }
    put(b']');
    put(b'\n');
    &out[..length]
}
