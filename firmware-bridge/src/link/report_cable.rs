//! Reports of 64 bytes as a cable: HID, or packets on a socket where there is no HID.
//!
//! ```text
//! servo ── queue (a socket of packets, never waits) ──▶ writer thread ── write (may wait) ──▶ device
//! relay ◀──────────────────────────── read with a time limit ─────────────────────────────── device
//! ```
//! A write to a HID device returns when the bus has taken the report: the servo must not wait for that.
//! The writer keeps the newest command alone; other messages keep their order.

use super::cable::{Cable, REPORT_BYTES, read_packet, wait_readable, write_packet};
use crate::rt;
use osteon_protocol::frame::COMMAND_FRAME_BYTES;
use rustix::io::Errno;
use rustix::net::{AddressFamily, SocketFlags, SocketType, socketpair, sockopt};
use std::fmt;
use std::os::fd::OwnedFd;
use std::sync::atomic::{AtomicBool, AtomicI32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

/// Room for some reports between servo and writer; the kernel rounds it up.
const QUEUE_BYTES: usize = 2048;
/// Most reports that the writer takes at once; the queue holds fewer.
const BURST: usize = 4096;
/// The writer looks at least this often whether it shall end.
const LOOK: Duration = Duration::from_millis(50);

/// A report.
pub(super) type Report = [u8; REPORT_BYTES];

/// What moves whole reports.
pub(super) trait ReportIo: Send + fmt::Debug + 'static {
    /// Reads one report within `limit`; false = none came.
    fn read(&self, report: &mut Report, limit: Duration) -> Result<bool, Errno>;
    /// Writes one report; may wait.
    fn write(&self, report: &Report) -> Result<(), Errno>;
}

/// The cable.
#[derive(Debug)]
pub(super) struct ReportCable<R: ReportIo> {
    reader: Mutex<Reader<R>>,
    queue: OwnedFd,
    failed: Arc<AtomicI32>,
    stop: Arc<AtomicBool>,
    writer: Option<JoinHandle<()>>,
}

#[derive(Debug)]
struct Reader<R> {
    io: R,
    // came while somebody waited
    waiting: Option<Report>,
}

impl<R: ReportIo> ReportCable<R> {
    /// A cable of one handle to read and one to write.
    pub(super) fn new(reader: R, writer: R) -> Result<Self, Errno> {
        let flags = SocketFlags::NONBLOCK | SocketFlags::CLOEXEC;
        let (queue, drain) = socketpair(AddressFamily::UNIX, SocketType::SEQPACKET, flags, None)?;
        sockopt::set_socket_send_buffer_size(&queue, QUEUE_BYTES)?;
        let failed = Arc::new(AtomicI32::new(0));
        let stop = Arc::new(AtomicBool::new(false));
        let (seen, flag) = (Arc::clone(&failed), Arc::clone(&stop));
        let thread = std::thread::Builder::new()
            .name("report-writer".to_owned())
            .spawn(move || write_all(&writer, &drain, &seen, &flag))
            .or(Err(Errno::AGAIN))?;
        Ok(Self {
            reader: Mutex::new(Reader {
                io: reader,
                waiting: None,
            }),
            queue,
            failed,
            stop,
            writer: Some(thread),
        })
    }
}

impl<R: ReportIo> Cable for ReportCable<R> {
    fn read(&self, into: &mut [u8]) -> Result<usize, Errno> {
        // only the thread that reads takes this lock
        let mut reader = self.reader.lock().unwrap_or_else(PoisonError::into_inner);
        let mut count = 0;
        while let Some(room) = into.get_mut(count..count + REPORT_BYTES) {
            let mut report = [0; REPORT_BYTES];
            match reader.waiting.take() {
                Some(waiting) => report = waiting,
                None if reader.io.read(&mut report, Duration::ZERO)? => {}
                None => break,
            }
            room.copy_from_slice(&report);
            count += REPORT_BYTES;
        }
        Ok(count)
    }

    fn write(&self, bytes: &[u8]) -> Result<usize, Errno> {
        match self.failed.load(Ordering::Relaxed) {
            0 => write_packet(&self.queue, bytes),
            code => Err(Errno::from_raw_os_error(code)),
        }
    }

    fn wait(&self, limit: Duration) {
        let mut reader = self.reader.lock().unwrap_or_else(PoisonError::into_inner);
        let mut report = [0; REPORT_BYTES];
        // a failure shows in the read that follows
        if reader.waiting.is_none() && reader.io.read(&mut report, limit).unwrap_or(false) {
            reader.waiting = Some(report);
        }
    }
}

impl<R: ReportIo> Drop for ReportCable<R> {
    fn drop(&mut self) {
        // what is queued (a disarm) still goes out
        self.stop.store(true, Ordering::Relaxed);
        if let Some(writer) = self.writer.take() {
            writer.join().unwrap_or(());
        }
    }
}

fn write_all<R: ReportIo>(io: &R, queue: &OwnedFd, failed: &AtomicI32, stop: &AtomicBool) {
    let _right = rt::set_fifo(rt::SERVO_PRIORITY - 1);
    loop {
        // asked before the queue is emptied: what was queued before the end is written
        let last_round = stop.load(Ordering::Relaxed);
        if !last_round {
            wait_readable(queue, LOOK);
        }
        if let Err(errno) = drain(io, queue) {
            failed.store(errno.raw_os_error(), Ordering::Relaxed);
            return;
        }
        if last_round {
            return;
        }
    }
}

/// Writes what is queued; of commands that follow each other only the last.
fn drain<R: ReportIo>(io: &R, queue: &OwnedFd) -> Result<(), Errno> {
    let mut held: Option<Report> = None;
    for _ in 0..BURST {
        let mut report = [0; REPORT_BYTES];
        if read_packet(queue, &mut report)? == 0 {
            break;
        }
        if let Some(before) = held.replace(report)
            && !(is_command(&before) && is_command(&report))
        {
            io.write(&before)?;
        }
    }
    held.map_or(Ok(()), |report| io.write(&report))
}

/// A command is the only host message whose frame has this length.
fn is_command(report: &Report) -> bool {
    report.iter().position(|byte| *byte == 0) == Some(COMMAND_FRAME_BYTES - 1)
}

/// Packets on a Unix socket in the place of HID reports.
#[derive(Debug)]
pub(super) struct PacketIo {
    socket: Arc<OwnedFd>,
}

impl PacketIo {
    /// Both handles of a connected, non-blocking socket.
    pub(super) fn both(socket: OwnedFd) -> (Self, Self) {
        let socket = Arc::new(socket);
        let other = Self {
            socket: Arc::clone(&socket),
        };
        (Self { socket }, other)
    }
}

impl ReportIo for PacketIo {
    fn read(&self, report: &mut Report, limit: Duration) -> Result<bool, Errno> {
        if !limit.is_zero() {
            wait_readable(&*self.socket, limit);
        }
        Ok(read_packet(&self.socket, report)? > 0)
    }

    fn write(&self, report: &Report) -> Result<(), Errno> {
        match rustix::io::write(&*self.socket, report) {
            // a peer that does not read loses reports, as on a bus
            Ok(_) | Err(Errno::AGAIN | Errno::INTR) => Ok(()),
            Err(errno) => Err(errno),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use osteon_protocol::device::{CommandFrame, HostMessage};
    use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};

    #[derive(Debug)]
    struct Slow(std::sync::mpsc::SyncSender<Report>, Arc<Mutex<()>>);

    impl ReportIo for Slow {
        fn read(&self, _: &mut Report, _: Duration) -> Result<bool, Errno> {
            Ok(false)
        }
        fn write(&self, report: &Report) -> Result<(), Errno> {
            let _turn = self.1.lock();
            self.0.send(*report).or(Err(Errno::PIPE))
        }
    }

    fn frame(message: HostMessage) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        encode(&message, &mut out).unwrap().to_vec()
    }

    #[test]
    fn a_bus_that_stalls_gets_the_newest_command_and_every_other_message_in_order() {
        let (sender, written) = std::sync::mpsc::sync_channel(64);
        let stall = Arc::new(Mutex::new(()));
        let io = || Slow(sender.clone(), Arc::clone(&stall));
        let cable = ReportCable::new(io(), io()).unwrap();
        let held = stall.lock().unwrap();
        let command = |seq| {
            HostMessage::Command(CommandFrame {
                seq,
                state_seq: 0,
                torque: [5, -6, 7],
                enable: true,
            })
        };
        assert!(cable.write(&frame(HostMessage::Home)).unwrap() > 0);
        std::thread::sleep(Duration::from_millis(100));
        let queued = [
            command(1),
            command(2),
            HostMessage::Arm,
            command(3),
            command(4),
        ];
        for message in queued {
            assert!(cable.write(&frame(message)).unwrap() > 0);
        }
        // the queue is short: the servo hears that the cable is full
        let mut took = 0;
        while cable.write(&frame(command(5))).unwrap() > 0 {
            took += 1;
            assert!(took < 200, "the queue never fills");
        }
        drop(held);
        drop(cable);
        let mut reader = FrameReader::new();
        let mut heard = Vec::new();
        for report in written.try_iter() {
            heard.extend(
                report
                    .iter()
                    .filter_map(|b| reader.push::<HostMessage>(*b))
                    .map(Result::unwrap),
            );
        }
        let numbers: Vec<u16> = heard
            .iter()
            .map(|m| match m {
                HostMessage::Home => 100,
                HostMessage::Arm => 200,
                HostMessage::Command(c) => c.seq,
                other => panic!("{other:?}"),
            })
            .collect();
        assert_eq!(numbers, [100, 2, 200, 5]);
    }
}
