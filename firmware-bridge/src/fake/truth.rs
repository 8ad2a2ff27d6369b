//! The ground truth file: one CSV line for each state frame, written by a thread of its own.

use super::device::Truth;
use anyhow::Context as _;
use osteon_protocol::device::DriveState;
use rtrb::{Consumer, Producer, RingBuffer};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::thread::JoinHandle;
use std::time::Duration;

/// First line of the file.
pub const HEADER: &str = "time_micros,seq,x_mm,y_mm,z_mm,drive,motors_on,torque1_nmm,\
    torque2_nmm,torque3_nmm,hand_fx_n,hand_fy_n,hand_fz_n,segment";

/// Records in flight: eight seconds of a writer that stands still.
const RING: usize = 8192;
/// The writer empties the ring and flushes the file this often.
const FLUSH_EVERY: Duration = Duration::from_millis(50);
/// Formatting needs no more stack than this, and the process locks its memory.
const STACK_BYTES: usize = 256 * 1024;

/// The device loop's end: takes records without waiting.
#[derive(Debug)]
pub struct TruthLog {
    ring: Producer<Truth>,
    writer: JoinHandle<io::Result<()>>,
    lost: u64,
}

impl TruthLog {
    /// Makes the file and starts its writer.
    pub fn create(path: &Path) -> anyhow::Result<Self> {
        let name = path.display();
        let file = File::create(path)
            .with_context(|| format!("truth {name}: cannot be made; give a writable --truth"))?;
        let (ring, records) = RingBuffer::new(RING);
        let writer = std::thread::Builder::new()
            .name("fake-truth".to_owned())
            .stack_size(STACK_BYTES)
            .spawn(move || write_all(records, file))
            .with_context(|| format!("truth {name}: no thread to write it"))?;
        Ok(Self {
            ring,
            writer,
            lost: 0,
        })
    }

    /// Hands one record over; counts it as lost where the writer is eight seconds behind.
    pub fn push(&mut self, truth: Truth) {
        if self.ring.push(truth).is_err() {
            self.lost += 1;
        }
    }

    /// Waits until everything is in the file.
    pub fn finish(self) -> anyhow::Result<()> {
        let Self { ring, writer, lost } = self;
        drop(ring);
        match writer.join() {
            Ok(outcome) => outcome.context("truth file: a write failed; free some disk space")?,
            Err(_) => anyhow::bail!("truth file: its writer crashed; the file is incomplete"),
        }
        anyhow::ensure!(
            lost == 0,
            "truth file: {lost} lines lost; give --truth a faster disk"
        );
        Ok(())
    }
}

fn write_all(mut records: Consumer<Truth>, file: File) -> io::Result<()> {
    let mut out = BufWriter::new(file);
    writeln!(out, "{HEADER}")?;
    loop {
        // Asked before the ring is emptied: what came before the end is not missed.
        let last_round = records.is_abandoned();
        while let Ok(truth) = records.pop() {
            write_row(&mut out, &truth)?;
        }
        out.flush()?;
        if last_round {
            return Ok(());
        }
        std::thread::sleep(FLUSH_EVERY);
    }
}

/// One line of the file.
pub fn write_row(out: &mut impl Write, truth: &Truth) -> io::Result<()> {
    let (p, t, f) = (truth.gimbal_mm, truth.torque_nmm, truth.hand_n);
    writeln!(
        out,
        "{},{},{:.6},{:.6},{:.6},{},{},{:.4},{:.4},{:.4},{:.5},{:.5},{:.5},{}",
        truth.time_micros,
        truth.seq,
        p.x,
        p.y,
        p.z,
        drive_name(truth.drive),
        u8::from(truth.motors_on),
        t.x,
        t.y,
        t.z,
        f.x,
        f.y,
        f.z,
        truth.segment,
    )
}

/// The drive state's name in the file.
pub fn drive_name(drive: DriveState) -> &'static str {
    match drive {
        DriveState::Boot => "boot",
        DriveState::Unhomed => "unhomed",
        DriveState::Homed => "homed",
        DriveState::Armed => "armed",
        DriveState::Active => "active",
        DriveState::Hold => "hold",
        DriveState::Tripped => "tripped",
        DriveState::Fault => "fault",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn every_record_reaches_the_file_in_order() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("truth.csv");
        let mut log = TruthLog::create(&path).unwrap();
        for n in 0..5000u16 {
            log.push(Truth {
                time_micros: u32::from(n) * 1000,
                seq: n,
                gimbal_mm: DVec3::new(1.5, -2.25, 3.0),
                drive: DriveState::Hold,
                motors_on: true,
                torque_nmm: DVec3::new(0.0, 10.0, -0.5),
                hand_n: DVec3::X,
                segment: -1,
            });
        }
        log.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), 5001);
        assert_eq!(lines[0].split(',').count(), 14);
        assert_eq!(
            lines[4322],
            "4321000,4321,1.500000,-2.250000,3.000000,hold,1,0.0000,10.0000,-0.5000,\
             1.00000,0.00000,0.00000,-1"
        );
    }
}
