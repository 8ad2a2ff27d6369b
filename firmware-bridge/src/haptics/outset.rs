//! What a session begins with beside device and servo: the publisher, its logs, its doors.

use super::HapticsArgs;
use super::net::Net;
use super::opening::{Session, publisher_of};
use super::publisher::Publisher;
use super::record::{RING_RECORDS, Record};
use super::session::{create, say};
use crate::clinic::guide::Guide;
use crate::keys;
use crate::scene::Scene;
use anyhow::Result;
use interprocess::local_socket::Listener;
use osteon_sim_core::servo::Request;
use rtrb::{Consumer, Producer, RingBuffer};
use std::io::{BufWriter, Write};
use std::path::Path;

/// A log that the publisher writes.
type Log = Option<Box<dyn Write + Send>>;

/// What was asked for, opened.
#[derive(Default)]
pub(super) struct Outset {
    guide: Option<Guide>,
    pose_log: Log,
    timing_log: Log,
    net: Option<Net>,
}

/// The servo's ends of the rings to and from the publisher.
pub(super) struct Rings {
    pub(super) records: Producer<Record>,
    pub(super) requests: Consumer<Request>,
}

impl Outset {
    /// Opens what the options ask for.
    pub(super) fn new(args: &HapticsArgs, scene: &Scene) -> Result<Self> {
        let poses = "tick,state_seq,time_micros,x_mm,y_mm,z_mm";
        let times = "monotonic_ns,wake_ns,tick_ns,skipped,publisher_bytes";
        Ok(Self {
            guide: Guide::new(args.task, args.scene.scene.as_deref(), scene)?,
            pose_log: log(args.pose_log.as_deref(), poses)?,
            timing_log: log(args.timing_log.as_deref(), times)?,
            net: open_port(args)?,
        })
    }

    /// The publisher, and the servo's ends of its rings.
    pub(super) fn publisher(
        self,
        session: &Session<'_>,
        listener: Listener,
        force_limit_n: f64,
        link_name: &str,
    ) -> (Publisher, Rings) {
        let (record_in, record_out) = RingBuffer::new(RING_RECORDS);
        let (request_in, request_out) = RingBuffer::new(64);
        let shown = (listener, link_name.to_owned());
        let ends = (record_out, request_in);
        let mut publisher = publisher_of(session, force_limit_n, shown, ends);
        publisher.guide = self.guide;
        publisher.pose_log = self.pose_log;
        publisher.timing_log = self.timing_log;
        publisher.net = self.net;
        let rings = Rings {
            records: record_in,
            requests: request_out,
        };
        (publisher, rings)
    }
}

/// A CSV file with these columns.
fn log(path: Option<&Path>, columns: &str) -> Result<Log> {
    let Some(path) = path else {
        return Ok(None);
    };
    let mut log = BufWriter::new(create(path)?);
    writeln!(log, "{columns}")?;
    Ok(Some(Box::new(log)))
}

/// The port for viewers on other machines, where one is asked for.
fn open_port(args: &HapticsArgs) -> Result<Option<Net>> {
    let Some(address) = &args.listen else {
        return Ok(None);
    };
    let identity = keys::identity(&args.keys)?;
    let net = Net::listen(address, identity, keys::trusted(&args.keys)?)?;
    say(&format!(
        "haptics: viewers with a trusted key can connect to {}",
        net.address()
    ));
    Ok(Some(net))
}
