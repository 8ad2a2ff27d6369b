//! Every fault by name.

use std::fmt;
use std::str::FromStr;

/// A fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[expect(missing_docs, reason = "the catalogue says what each is")]
pub enum Fault {
    DropByte,
    DropFrame,
    DropFrames,
    FlipBit,
    FlipBits,
    InsertByte,
    InsertBytes,
    Truncate,
    Duplicate,
    Reorder,
    Split,
    Merge,
    Gap4,
    Delay5,
    Delay20,
    Delay150,
    Burst,
    StopReading,
    StopSending,
    SeqWrap,
    DriftFast,
    DriftSlow,
    ClockForward,
    ClockBack,
    EncoderWrap,
    EncoderGlitch,
    EncoderJump,
    EncoderStuck,
    PotDropout,
    ButtonBounce,
    DockSwitch,
    OverTemperature,
    EStop,
    SelfTest,
    BrownOut,
    Unplug,
    WrongSchema,
    WrongVersion,
    TwoHosts,
}

/// Where a fault acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Direction {
    /// On the way from the device to the host.
    ToHost,
    /// On the way from the host to the device.
    ToDevice,
    /// In the device, or on the whole cable.
    Device,
}

/// Which part of the bench makes a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Where {
    /// One direction of the cable ([`super::Lane`]).
    Lane,
    /// The device's sensors ([`super::sensors::SensorFault`]).
    Sensors,
    /// How the device was built: it holds from its start.
    Setup,
    /// The device and its plug as a whole.
    World,
}

/// A line of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Entry {
    /// Which.
    pub fault: Fault,
    /// Its name.
    pub name: &'static str,
    /// Directions in which it has a meaning.
    pub directions: &'static [Direction],
    /// Which part of the bench makes it.
    pub place: Where,
    /// A session must go on with it: the drive stays active.
    pub benign: bool,
    /// How long it lasts, ms; 0: a single frame or sample, or until the cause is taken away.
    pub lasts_ms: u32,
    /// What happens.
    pub about: &'static str,
}

use Direction::{Device, ToDevice, ToHost};
use Where::{Lane, Sensors, Setup, World};

const BOTH: &[Direction] = &[ToHost, ToDevice];
const WITHIN: &[Direction] = &[Device];

const fn entry(
    fault: Fault,
    name: &'static str,
    (place, directions): (Where, &'static [Direction]),
    benign: bool,
    lasts_ms: u32,
    about: &'static str,
) -> Entry {
    Entry {
        fault,
        name,
        directions,
        place,
        benign,
        lasts_ms,
        about,
    }
}

const LANE: (Where, &[Direction]) = (Lane, BOTH);
const SENSE: (Where, &[Direction]) = (Sensors, WITHIN);
const TELLS: (Where, &[Direction]) = (Lane, &[ToHost]);
const WHOLE: (Where, &[Direction]) = (World, WITHIN);
const BUILT: (Where, &[Direction]) = (Setup, WITHIN);

/// Every fault, in the order of reports.
#[rustfmt::skip]
pub const CATALOGUE: &[Entry] = &[
    entry(Fault::DropByte, "drop-byte", LANE, true, 0, "one byte of a frame is lost"),
    entry(Fault::DropFrame, "drop-frame", LANE, true, 0, "one frame is lost"),
    entry(Fault::DropFrames, "drop-frames", LANE, false, 100, "every frame is lost"),
    entry(Fault::FlipBit, "flip-bit", LANE, true, 0, "one bit of a frame is flipped"),
    entry(Fault::FlipBits, "flip-bits", LANE, false, 100, "1 to 8 bits are flipped in every frame"),
    entry(Fault::InsertByte, "insert-byte", LANE, true, 0, "one byte too many in a frame"),
    entry(Fault::InsertBytes, "insert-bytes", LANE, false, 100, "1 to 4 bytes too many in every frame"),
    entry(Fault::Truncate, "truncate", LANE, true, 0, "the rest of a frame is lost, its end as well: it runs into the next"),
    entry(Fault::Duplicate, "duplicate", LANE, true, 100, "every frame comes twice"),
    entry(Fault::Reorder, "reorder", LANE, true, 100, "two frames change places, again and again"),
    entry(Fault::Split, "split", LANE, true, 100, "every frame comes byte by byte"),
    entry(Fault::Merge, "merge", LANE, true, 100, "two frames come in one piece, again and again"),
    entry(Fault::Gap4, "gap-4", LANE, true, 4, "nothing gets through for 4 ms"),
    entry(Fault::Delay5, "delay-5", LANE, true, 200, "every frame is 5 ms late"),
    entry(Fault::Delay20, "delay-20", LANE, false, 200, "every frame is 20 ms late"),
    entry(Fault::Delay150, "delay-150", LANE, false, 300, "every frame is 150 ms late"),
    entry(Fault::Burst, "burst", LANE, false, 60, "frames wait and come all at once at the end"),
    entry(Fault::StopReading, "stop-reading", LANE, false, 150, "the receiver reads nothing, then the whole queue"),
    entry(Fault::StopSending, "stop-sending", LANE, false, 150, "the sender says nothing"),
    entry(Fault::SeqWrap, "seq-wrap", (Setup, BOTH), true, 0, "the frame counter wraps at 65,535"),
    entry(Fault::DriftFast, "drift-fast", BUILT, true, 0, "the device's clock is 100 ppm fast"),
    entry(Fault::DriftSlow, "drift-slow", BUILT, true, 0, "the device's clock is 100 ppm slow"),
    entry(Fault::ClockForward, "clock-forward", TELLS, true, 0, "the device's time stamps jump 1 s ahead"),
    entry(Fault::ClockBack, "clock-back", TELLS, true, 0, "the device's time stamps jump 1 s back"),
    entry(Fault::EncoderWrap, "encoder-wrap", BUILT, true, 0, "the encoders' 32 bits wrap in the workspace"),
    entry(Fault::EncoderGlitch, "encoder-glitch", SENSE, true, 0, "one sample of a joint is 50 to 2000 counts off"),
    entry(Fault::EncoderJump, "encoder-jump", SENSE, true, 0, "a joint misses 3 to 40 counts, for good"),
    entry(Fault::EncoderStuck, "encoder-stuck", SENSE, true, 200, "a joint's encoder stands still"),
    entry(Fault::PotDropout, "pot-dropout", SENSE, true, 20, "a wrist's potentiometer reads its end"),
    entry(Fault::ButtonBounce, "button-bounce", SENSE, true, 60, "a button bounces when it is pressed and let go"),
    entry(Fault::DockSwitch, "dock-switch", SENSE, true, 100, "the dock's switch closes while the drive is active"),
    entry(Fault::OverTemperature, "over-temperature", SENSE, false, 0, "a winding is too hot"),
    entry(Fault::EStop, "e-stop", SENSE, false, 0, "the emergency stop is pressed"),
    entry(Fault::SelfTest, "self-test", SENSE, false, 0, "the device's self-test finds a fault"),
    entry(Fault::BrownOut, "brown-out", WHOLE, false, 0, "the supply fails for a moment: the device starts anew"),
    entry(Fault::Unplug, "unplug", WHOLE, false, 300, "the plug is pulled and put back"),
    entry(Fault::WrongSchema, "wrong-schema", (Setup, WITHIN), false, 0, "the device lays its messages out otherwise"),
    entry(Fault::WrongVersion, "wrong-version", (Setup, WITHIN), false, 0, "the device speaks another version"),
    entry(Fault::TwoHosts, "two-hosts", (World, &[ToDevice]), false, 0, "a second host says hello on the same port"),
];

impl Fault {
    /// Its line of the catalogue.
    pub fn entry(self) -> &'static Entry {
        // every fault has a line: a test counts them
        CATALOGUE
            .iter()
            .find(|entry| entry.fault == self)
            .unwrap_or(&CATALOGUE[0])
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.entry().name)
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let found = CATALOGUE.iter().find(|entry| entry.name == text);
        found.map(|entry| entry.fault).ok_or_else(|| {
            let names: Vec<&str> = CATALOGUE.iter().map(|entry| entry.name).collect();
            format!("no fault '{text}'; there are {}", names.join(", "))
        })
    }
}

impl fmt::Display for Direction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ToHost => "to-host",
            ToDevice => "to-device",
            Device => "device",
        })
    }
}

impl FromStr for Direction {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        [ToHost, ToDevice, Device]
            .into_iter()
            .find(|direction| direction.to_string() == text)
            .ok_or_else(|| format!("no direction '{text}'; give to-host, to-device or device"))
    }
}
