//! What `--device` may say, and how it is opened.

use super::hd::HdLink;
use super::hid::open_hid;
use super::open::BAUD;
use super::port::group_of;
use super::report_cable::{PacketIo, ReportCable};
use super::sim::open_sim;
use super::{DeviceLink, HfabLink, LinkError, OpenLink};
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketAddrUnix, SocketFlags, SocketType, connect, socket_with};
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

/// The kinds of `--device`, one a line, for help and error messages.
pub const KINDS: &str = "open:PATH[@BAUD] (open controller on a serial port), hid:VID:PID (the same as HID \
    reports), hfab:PATH (WoodenHaptics, vintage Phantom), openhaptics[:NAME] (Omni, Touch through 3D \
    Systems' library), packet:PATH (the same reports over a socket), sim[:STROKE.json] (simulated, in \
    this process)";

/// Which device, and by what way in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DeviceSpec {
    /// Open protocol on a serial port.
    Open {
        /// The port.
        path: String,
        /// Bits a second, for a real UART.
        baud: u32,
    },
    /// Open protocol as HID reports.
    Hid {
        /// USB vendor.
        vendor: u16,
        /// USB product.
        product: u16,
    },
    /// Open protocol as packets of a Unix socket.
    Packet(PathBuf),
    /// Text lines of hfab controllers on a serial port.
    Hfab(String),
    /// The vendor's library; the device's name as its driver knows it, or its default device.
    OpenHaptics(Option<String>),
    /// A simulated device in this process; what its hand does.
    Sim(Option<PathBuf>),
}

impl FromStr for DeviceSpec {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (kind, rest) = match text.split_once(':') {
            Some((kind, rest)) => (kind, Some(rest)),
            None => (text, None),
        };
        let path = || match rest {
            Some(path) if !path.is_empty() => Ok(path.to_owned()),
            _ => Err(format!("{text}: a path is missing after '{kind}:'")),
        };
        match kind {
            "open" => open_spec(&path()?),
            "hid" => hid_spec(text, rest),
            "packet" => Ok(Self::Packet(path()?.into())),
            "hfab" => Ok(Self::Hfab(path()?)),
            "openhaptics" => Ok(Self::OpenHaptics(
                rest.filter(|n| !n.is_empty()).map(Into::into),
            )),
            "sim" => Ok(Self::Sim(rest.filter(|n| !n.is_empty()).map(Into::into))),
            _ => Err(format!("{text}: unknown kind; give {KINDS}")),
        }
    }
}

impl DeviceSpec {
    /// The protocol that this kind speaks, for people.
    pub fn protocol(&self) -> &'static str {
        match self {
            Self::Open { .. } | Self::Sim(_) => "the open protocol",
            Self::Hid { .. } | Self::Packet(_) => "the open protocol's reports",
            Self::Hfab(_) => "hfab's text lines",
            Self::OpenHaptics(_) => "the vendor's library",
        }
    }
}

fn open_spec(rest: &str) -> Result<DeviceSpec, String> {
    let (path, baud) = match rest.rsplit_once('@') {
        Some((path, rate)) => {
            let baud = rate
                .parse()
                .ok()
                .filter(|b| (1200..=50_000_000).contains(b));
            let baud = baud.ok_or_else(|| {
                format!("open:{rest}: '{rate}' is no bit rate; give 1000000, for example")
            })?;
            (path, baud)
        }
        None => (rest, BAUD),
    };
    Ok(DeviceSpec::Open {
        path: path.to_owned(),
        baud,
    })
}

fn hid_spec(text: &str, rest: Option<&str>) -> Result<DeviceSpec, String> {
    let number = |n: &str| u16::from_str_radix(n, 16).ok();
    let both = rest.and_then(|r| r.split_once(':'));
    match both.map(|(v, p)| (number(v), number(p))) {
        Some((Some(vendor), Some(product))) => Ok(DeviceSpec::Hid { vendor, product }),
        _ => Err(format!(
            "{text}: give two hexadecimal numbers, hid:VID:PID, as 'osteon devices' lists them"
        )),
    }
}

impl fmt::Display for DeviceSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let named = |f: &mut fmt::Formatter<'_>, kind: &str, name: Option<&str>| match name {
            Some(name) => write!(f, "{kind}:{name}"),
            None => f.write_str(kind),
        };
        match self {
            Self::Open { path, baud } if *baud == BAUD => write!(f, "open:{path}"),
            Self::Open { path, baud } => write!(f, "open:{path}@{baud}"),
            Self::Hid { vendor, product } => write!(f, "hid:{vendor:04x}:{product:04x}"),
            Self::Packet(path) => write!(f, "packet:{}", path.display()),
            Self::Hfab(path) => write!(f, "hfab:{path}"),
            Self::OpenHaptics(name) => named(f, "openhaptics", name.as_deref()),
            Self::Sim(path) => named(f, "sim", path.as_ref().and_then(|p| p.to_str())),
        }
    }
}

/// Opens a device; it is armed later, by [`DeviceLink::prepare`]. Takes some seconds at most.
pub fn open(spec: &DeviceSpec) -> Result<Box<dyn DeviceLink>, LinkError> {
    let name: Arc<str> = spec.to_string().into();
    Ok(match spec {
        DeviceSpec::Open { path, baud } => Box::new(OpenLink::serial(path, *baud, name)?),
        DeviceSpec::Hid { vendor, product } => Box::new(open_hid(*vendor, *product, name)?),
        DeviceSpec::Packet(path) => Box::new(open_packet(path, name)?),
        DeviceSpec::Hfab(path) => Box::new(HfabLink::open(path, name)?),
        DeviceSpec::OpenHaptics(device) => Box::new(HdLink::open(device.as_deref(), name)?),
        DeviceSpec::Sim(stroke) => Box::new(open_sim(stroke.as_deref(), name)?),
    })
}

fn open_packet(path: &std::path::Path, name: Arc<str>) -> Result<OpenLink, LinkError> {
    let refusal = |errno: Errno| match errno {
        Errno::NOENT | Errno::CONNREFUSED => LinkError::NoPort {
            link: Arc::clone(&name),
            available: "none listens there".to_owned(),
        },
        Errno::ACCESS | Errno::PERM => LinkError::Denied {
            link: Arc::clone(&name),
            group: group_of(&path.display().to_string()),
        },
        Errno::AGAIN => LinkError::Busy {
            link: Arc::clone(&name),
        },
        other => LinkError::Setup {
            link: Arc::clone(&name),
            why: other.to_string(),
        },
    };
    let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
    let socket = socket_with(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None);
    let socket = socket.map_err(refusal)?;
    let address = SocketAddrUnix::new(path).map_err(refusal)?;
    connect(&socket, &address).map_err(refusal)?;
    let (reader, writer) = PacketIo::both(socket);
    let cable = ReportCable::new(reader, writer).map_err(refusal)?;
    match OpenLink::over(Arc::new(cable), Arc::clone(&name)) {
        // the device serves one host and hangs up on the others
        Err(LinkError::Gone { .. }) => Err(LinkError::Busy { link: name }),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_named_is_understood_and_printed_the_same() {
        for text in [
            "open:/dev/ttyACM0",
            "open:/dev/ttyUSB0@2000000",
            "hid:1209:0001",
            "packet:/run/x",
            "hfab:/dev/serial/by-id/usb-Teensyduino",
            "openhaptics",
            "openhaptics:Default Device",
            "sim",
            "sim:/tmp/stroke.json",
        ] {
            assert_eq!(text.parse::<DeviceSpec>().unwrap().to_string(), text);
        }
        for text in [
            "",
            "open",
            "open:",
            "usb:1",
            "hid:12",
            "hid:zz:1",
            "hid:12345:1",
            "open:/dev/x@",
            "open:x@12",
            "open:x@fast",
            "packet:",
            "hfab",
        ] {
            let error = text.parse::<DeviceSpec>().unwrap_err();
            assert!(error.starts_with(text) && !error.contains('\n'), "{error}");
        }
    }
}
