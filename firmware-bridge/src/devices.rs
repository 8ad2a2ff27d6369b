//! `osteon devices`: what is plugged in, which protocol answers, and what keeps it from a session.
//!
//! Serial ports are asked in both protocols: a hello of the open protocol, then a line of zero currents as
//! hfab controllers want it. Of HID devices only those are asked whose reports are their maker's own (usage
//! page 0xFF00 and above): a keyboard gets no report from here. Nothing turns a motor on; a port that another
//! program holds is left alone.

use crate::fake::run::default_link;
use crate::link::{self, DeviceSpec, HidFound, LinkError};
use serde::Serialize;
use serialport::SerialPortType;
use std::collections::BTreeSet;
use std::io::Write as _;
use std::path::PathBuf;

/// USB numbers of 3D Systems' stock devices, whose protocol is closed: vendor, product.
const STOCK: [(u16, u16); 3] = [(0x0301, 0x2988), (0x2988, 0x0302), (0x2988, 0x0304)];
const STOCK_REMEDY: &str = "a stock Touch speaks a closed protocol; install its driver and OpenHaptics from 3D Systems \
     and give --device openhaptics";
/// From this usage page on reports are their maker's own.
const MAKERS_PAGE: u16 = 0xFF00;

/// Options of `devices`.
#[derive(Debug, Clone, clap::Args)]
pub struct DevicesArgs {
    /// Look at these devices only, as --device names them; a plain PATH is a serial port [default: all that
    /// this machine lists, and a simulated one at its usual place]
    #[arg(value_name = "DEVICE")]
    pub device: Vec<String>,
    /// Only list: send nothing to any device
    #[arg(long)]
    pub list_only: bool,
    /// Write the list as JSON
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// One thing that is plugged in, or was asked for.
#[derive(Debug, Clone, Serialize)]
pub struct Listed {
    /// What to give to `--device`, if it can be used.
    pub device: Option<String>,
    /// Port or device file.
    pub node: String,
    /// What the system knows of it.
    pub name: String,
    /// USB vendor and product, hexadecimal.
    pub usb: Option<String>,
    /// The protocol that answered.
    pub protocol: Option<&'static str>,
    /// Model, serial number and firmware, as far as the device says.
    pub model: Option<String>,
    /// Its state, where a session can begin.
    pub state: Option<String>,
    /// What keeps it from a session, with its remedy.
    pub problem: Option<String>,
}

/// A device to be asked.
struct Candidate {
    listed: Listed,
    // protocols to try, in their order
    tries: Vec<String>,
}

/// Lists and asks. A machine without devices is no error.
pub fn run(args: &DevicesArgs) -> anyhow::Result<()> {
    let candidates = if args.device.is_empty() {
        everything()
    } else {
        args.device.iter().map(|d| named(d)).collect()
    };
    let all = ask_all(candidates, args.list_only)?;
    let mut out = std::io::stdout();
    if all.is_empty() {
        writeln!(
            out,
            "no serial ports and no HID devices; 'osteon fake-omni' makes a simulated one"
        )?;
    }
    for listed in &all {
        writeln!(out, "{}", listed.line())?;
    }
    if args.device.is_empty() {
        writeln!(out, "{}", library())?;
    }
    if let Some(path) = &args.json {
        std::fs::write(path, serde_json::to_vec_pretty(&all)?)
            .map_err(|e| anyhow::anyhow!("{}: cannot write ({e})", path.display()))?;
    }
    Ok(())
}

/// All that the system lists, and the simulated device's usual place.
fn everything() -> Vec<Candidate> {
    let mut seen = BTreeSet::new();
    let mut all = Vec::new();
    let fake = default_link();
    if fake.exists() {
        let path = fake.display().to_string();
        all.push(port(&path, "simulated device".to_owned(), None));
    }
    for found in serialport::available_ports().unwrap_or_default() {
        if seen.insert(found.port_name.clone()) {
            let (name, usb) = about(&found.port_type);
            let mut one = port(&found.port_name, name, usb);
            if is_console(&found.port_name) {
                one.tries.clear();
                "the kernel's console: not asked".clone_into(&mut one.listed.name);
            }
            all.push(one);
        }
    }
    all.extend(link::hid_found().iter().map(report));
    all
}

/// Whether the kernel writes its messages to this port.
fn is_console(port: &str) -> bool {
    let active = std::fs::read_to_string("/sys/class/tty/console/active").unwrap_or_default();
    active
        .split_whitespace()
        .any(|name| port.strip_prefix("/dev/") == Some(name))
}

fn about(kind: &SerialPortType) -> (String, Option<(u16, u16)>) {
    match kind {
        SerialPortType::UsbPort(usb) => {
            let parts = [&usb.manufacturer, &usb.product, &usb.serial_number];
            let name: Vec<&str> = parts.into_iter().flatten().map(String::as_str).collect();
            (name.join(" "), Some((usb.vid, usb.pid)))
        }
        SerialPortType::PciPort => ("built-in serial port".to_owned(), None),
        SerialPortType::BluetoothPort => ("Bluetooth serial port".to_owned(), None),
        SerialPortType::Unknown => (String::new(), None),
    }
}

fn port(path: &str, name: String, usb: Option<(u16, u16)>) -> Candidate {
    candidate(path, name, usb, &["open", "hfab"])
}

fn candidate(node: &str, name: String, usb: Option<(u16, u16)>, kinds: &[&str]) -> Candidate {
    let stock = usb.is_some_and(|ids| STOCK.contains(&ids));
    Candidate {
        listed: Listed {
            device: stock.then(|| "openhaptics".to_owned()),
            node: node.to_owned(),
            name,
            usb: usb.map(|(v, p)| format!("{v:04x}:{p:04x}")),
            protocol: None,
            model: None,
            state: None,
            problem: stock.then(|| STOCK_REMEDY.to_owned()),
        },
        tries: if stock {
            Vec::new()
        } else {
            kinds.iter().map(|kind| format!("{kind}:{node}")).collect()
        },
    }
}

fn report(found: &HidFound) -> Candidate {
    let (vendor, product) = found.ids;
    let mut candidate = candidate(&found.node, found.name.clone(), Some(found.ids), &[]);
    let own = found.usage_page >= MAKERS_PAGE;
    if own && candidate.listed.problem.is_none() {
        candidate.tries = vec![format!("hid:{vendor:04x}:{product:04x}")];
    }
    candidate
}

/// What the user names: a kind and its place, or a serial port.
fn named(text: &str) -> Candidate {
    if text.parse::<DeviceSpec>().is_ok() {
        let mut one = candidate(text, String::new(), None, &[]);
        one.tries = vec![text.to_owned()];
        return one;
    }
    port(text, String::new(), None)
}

/// Asks all at once: each may take some seconds to be found silent.
fn ask_all(candidates: Vec<Candidate>, list_only: bool) -> anyhow::Result<Vec<Listed>> {
    let mut asked = Vec::new();
    for candidate in candidates {
        let asking = std::thread::Builder::new().name("device-probe".to_owned());
        asked.push(asking.spawn(move || {
            if list_only {
                candidate.listed
            } else {
                ask(candidate)
            }
        })?);
    }
    asked
        .into_iter()
        .map(|thread| {
            let died = |_| anyhow::anyhow!("a probe crashed; please report this");
            thread.join().map_err(died)
        })
        .collect()
}

fn ask(candidate: Candidate) -> Listed {
    let Candidate { mut listed, tries } = candidate;
    let mut first_refusal = None;
    for name in &tries {
        match try_one(name, &mut listed) {
            Ok(()) => return listed,
            // the other protocol's turn; what the first said is the better reason
            Err(
                error @ (LinkError::Silent { .. }
                | LinkError::Foreign { .. }
                | LinkError::WrongBaud { .. }
                | LinkError::WrongKind { .. }),
            ) => {
                first_refusal.get_or_insert(error);
            }
            Err(error) => {
                listed.problem = Some(error.to_string());
                return listed;
            }
        }
    }
    listed.problem = first_refusal
        .map(|error| error.to_string())
        .or(listed.problem);
    listed
}

fn try_one(name: &str, listed: &mut Listed) -> Result<(), LinkError> {
    let Ok(spec) = name.parse::<DeviceSpec>() else {
        return Ok(());
    };
    let mut link = link::open(&spec)?;
    let info = link.info();
    listed.device = Some(name.to_owned());
    listed.protocol = Some(spec.protocol());
    let parts = [info.model.clone(), info.firmware.clone()];
    let mut words: Vec<String> = parts.into_iter().filter(|p| !p.is_empty()).collect();
    if !info.serial.is_empty() {
        words.push(format!("serial {}", info.serial));
    }
    listed.model = Some(words.join(", "));
    match link.look() {
        Ok(state) => listed.state = Some(state),
        Err(error) => listed.problem = Some(error.to_string()),
    }
    Ok(())
}

fn library() -> String {
    match link::vendor_library() {
        Ok(path) => format!(
            "ok   openhaptics: {path} is there; --device openhaptics asks it for its device"
        ),
        Err(why) => format!(
            "--   openhaptics: no vendor library ({why}); only a stock Omni or Touch needs it"
        ),
    }
}

impl Listed {
    fn line(&self) -> String {
        let what = self.device.as_ref().unwrap_or(&self.node);
        let mut parts = vec![what.clone()];
        let known = [Some(&self.name), self.usb.as_ref(), self.model.as_ref()];
        parts.extend(
            known
                .into_iter()
                .flatten()
                .filter(|p| !p.is_empty())
                .cloned(),
        );
        if let Some(protocol) = self.protocol {
            parts.push(format!("answers in {protocol}"));
        }
        parts.extend(self.state.clone());
        let mark = match (&self.problem, &self.state) {
            (Some(_), _) => "NOTE",
            (None, Some(_)) => "ok  ",
            (None, None) => "--  ",
        };
        let problem = self.problem.as_ref().map(|p| format!("\n     {p}"));
        format!("{mark} {}{}", parts.join("; "), problem.unwrap_or_default())
    }
}
