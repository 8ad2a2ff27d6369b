//! HID devices: the open protocol in reports of 64 bytes, through the kernel's hidraw.

use super::report_cable::{Report, ReportCable, ReportIo};
use super::{LinkError, OpenLink};
use hidapi::{HidApi, HidDevice, HidError};
use rustix::fs::{Access, FlockOperation, Mode, OFlags};
use rustix::io::Errno;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::time::Duration;

/// A HID device of this machine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HidFound {
    /// USB vendor and product.
    pub ids: (u16, u16),
    /// Device file.
    pub node: String,
    /// Maker and product, for people.
    pub name: String,
    /// Usage page of its reports (0xFF00 and above: its maker's own).
    pub usage_page: u16,
    /// Whether this user may open it.
    pub may_open: bool,
}

/// The HID devices of this machine, each once.
pub fn found() -> Vec<HidFound> {
    let Ok(api) = HidApi::new() else {
        return Vec::new();
    };
    let mut all: Vec<HidFound> = api
        .device_list()
        .map(|d| {
            let node = d.path().to_string_lossy().into_owned();
            let name = [d.manufacturer_string(), d.product_string()];
            HidFound {
                ids: (d.vendor_id(), d.product_id()),
                usage_page: d.usage_page(),
                may_open: rustix::fs::access(&*node, Access::READ_OK | Access::WRITE_OK).is_ok(),
                node,
                name: name.into_iter().flatten().collect::<Vec<_>>().join(" "),
            }
        })
        .collect();
    // a device with several usages is listed once for each: its maker's own is kept
    all.sort_by(|a, b| (&a.node, b.usage_page).cmp(&(&b.node, a.usage_page)));
    all.dedup_by(|a, b| a.node == b.node);
    all
}

/// The HID devices as a list for an error message.
fn available() -> String {
    let names: Vec<String> = found()
        .iter()
        .map(|d| format!("{:04x}:{:04x} {}", d.ids.0, d.ids.1, d.name))
        .collect();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

/// Opens the first HID device of these numbers and shakes hands.
pub(super) fn open_hid(vendor: u16, product: u16, name: Arc<str>) -> Result<OpenLink, LinkError> {
    let here = found().into_iter().find(|d| d.ids == (vendor, product));
    let Some(device) = here else {
        return Err(LinkError::NoHid {
            link: name,
            available: available(),
        });
    };
    if !device.may_open {
        return Err(LinkError::DeniedHid {
            link: name,
            node: device.node,
        });
    }
    let setup = |why: String| LinkError::Setup {
        link: Arc::clone(&name),
        why,
    };
    let claim = claim(&device.node, &name)?;
    let api = HidApi::new().map_err(|e| setup(e.to_string()))?;
    let path = std::ffi::CString::new(device.node).map_err(|e| setup(e.to_string()))?;
    let open = || api.open_path(&path).map_err(|e| setup(e.to_string()));
    let (reader, writer) = (open()?, open()?);
    let io = |device, claim| HidIo {
        device,
        _claim: claim,
    };
    let cable = ReportCable::new(io(reader, Some(claim)), io(writer, None))
        .map_err(|e| setup(e.to_string()))?;
    OpenLink::over(Arc::new(cable), name)
}

/// hidraw lets every program in: a lock on the device file keeps two hosts apart.
fn claim(node: &str, name: &Arc<str>) -> Result<OwnedFd, LinkError> {
    let flags = OFlags::RDONLY | OFlags::CLOEXEC | OFlags::NONBLOCK;
    let file = rustix::fs::open(node, flags, Mode::empty()).and_then(|file| {
        rustix::fs::flock(&file, FlockOperation::NonBlockingLockExclusive)?;
        Ok(file)
    });
    file.map_err(|errno| match errno {
        Errno::WOULDBLOCK => LinkError::Busy {
            link: Arc::clone(name),
        },
        other => LinkError::Setup {
            link: Arc::clone(name),
            why: other.to_string(),
        },
    })
}

struct HidIo {
    device: HidDevice,
    _claim: Option<OwnedFd>,
}

impl std::fmt::Debug for HidIo {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("HidIo")
    }
}

impl ReportIo for HidIo {
    fn read(&self, report: &mut Report, limit: Duration) -> Result<bool, Errno> {
        let limit_ms = i32::try_from(limit.as_millis()).unwrap_or(i32::MAX);
        let read = self.device.read_timeout(report, limit_ms);
        read.map(|bytes| bytes > 0).map_err(|e| errno(&e))
    }

    fn write(&self, report: &Report) -> Result<(), Errno> {
        // the first byte is the report's number; 0 = the device has no numbers
        let mut numbered = [0; 1 + size_of::<Report>()];
        numbered[1..].copy_from_slice(report);
        self.device
            .write(&numbered)
            .map(drop)
            .map_err(|e| errno(&e))
    }
}

/// What the system said, as far as the crate passes it on.
fn errno(error: &HidError) -> Errno {
    match error {
        HidError::IoError { error } => error
            .raw_os_error()
            .map_or(Errno::IO, Errno::from_raw_os_error),
        // the crate says in words that a device has gone
        _ => Errno::NODEV,
    }
}
