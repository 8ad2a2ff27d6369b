//! Device, cable and host on one virtual clock, in ns.
//!
//! The device ticks at whole milliseconds of its own clock, the host half a millisecond later, a frame takes
//! 0.2 ms each way: a command is in force one tick after the state it answers, as on a good cable.

use super::host::{End, Loop, Shared, Start};
use crate::fake::device::{Device, DeviceSetup, Truth};
use crate::fake::faults::{Direction, Fault, Lane, Planned, Where};
use crate::haptics::record::TickRecord;
use crate::haptics::servo_loop::Beat;
use crate::haptics::session::ending_text;
use crate::link::DeviceInfo;
use crate::scene::{Scene, SceneArgs, load};
use osteon_protocol::device::{CommandFrame, DEVICE_SCHEMA, DEVICE_VERSION, HostMessage};
use osteon_protocol::firmware::DriveConfig;
use osteon_protocol::frame::{FrameReader, MAX_FRAME, encode};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::feel::Feel;
use osteon_sim_core::register::bone_from_base;
use osteon_sim_core::servo::{Servo, ServoSetup};
use osteon_sim_core::tool::Tool;
use std::collections::HashMap;
use std::sync::Arc;

const MS: u64 = 1_000_000;
const TRANSIT_NS: u64 = MS / 5;

/// Bone, tools and a fresh servo.
#[derive(Debug)]
pub struct Lab {
    scene: Scene,
    tools: Vec<Tool>,
    servo: Servo,
}

impl Lab {
    /// The built-in phantom, coarse: what is looked at here are torques.
    pub fn new() -> anyhow::Result<Arc<Self>> {
        let args = SceneArgs {
            voxel_mm: Some(1.5),
            ..SceneArgs::default()
        };
        Self::with(
            load(&args, &mut |_, _| {})?,
            Tool::standard_set(),
            &Feel::default(),
        )
    }

    /// A scene with its tools.
    pub fn with(scene: Scene, tools: Vec<Tool>, feel: &Feel) -> anyhow::Result<Arc<Self>> {
        let setup = ServoSetup {
            bone: Arc::clone(&scene.bone),
            tools: tools.clone(),
            bone_from_base: bone_from_base(&scene.bone_from_plan, scene.bone.lps_from_bone()),
            bone_from_plan: scene.bone_from_plan,
            device: DeviceInfo::omni(&DriveConfig::omni(1).hello).scale,
            force_limit_n: 3.3,
            feel: *feel,
        };
        let servo = Servo::new(setup).ok_or_else(|| anyhow::anyhow!("no tools"))?;
        Ok(Arc::new(Self {
            scene,
            tools,
            servo,
        }))
    }
}

enum Phase {
    Starting(Start, Box<Servo>),
    Running(Box<Loop>),
    // why, and the servo for a session that follows
    Over(String, Box<Servo>),
}

/// The bench.
pub struct World {
    lab: Arc<Lab>,
    now: u64,
    device_next: u64,
    device_period: u64,
    host_next: u64,
    device: Device,
    to_device: Lane,
    to_host: Lane,
    end: Shared,
    host: Phase,
    first_command: u16,
    plugged_at: Option<u64>,
    intruder: Option<u16>,
    heard: FrameReader,
    sent: HashMap<u16, CommandFrame>,
    newest: Option<CommandFrame>,
    wrongly_applied: u32,
    // ticks of the servo's loop, where somebody wants them
    kept: Option<Vec<TickRecord>>,
}

impl std::fmt::Debug for World {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("World")
            .field("now", &self.now)
            .finish_non_exhaustive()
    }
}

impl World {
    /// A device that powers up, and a host that starts at the same time. `ppm`: how fast the device's clock is.
    pub fn new(lab: &Arc<Lab>, setup: DeviceSetup, ppm: i32, first_command: u16) -> Self {
        let end = Shared::default();
        let servo = Box::new(lab.servo.clone());
        Self {
            lab: Arc::clone(lab),
            now: 0,
            device_next: MS,
            // 100 ppm of 1 ms are 100 ns; a fast clock's millisecond is short
            device_period: MS.saturating_add_signed(-i64::from(ppm)),
            host_next: MS + MS / 2,
            device: Device::build(setup),
            to_device: Lane::new(TRANSIT_NS),
            to_host: Lane::new(TRANSIT_NS),
            end,
            host: Phase::Starting(Start::default(), servo),
            first_command,
            plugged_at: None,
            intruder: None,
            heard: FrameReader::new(),
            sent: HashMap::new(),
            newest: None,
            wrongly_applied: 0,
            kept: None,
        }
    }

    /// The same world once more: both go on by themselves. Only while the session runs.
    pub fn fork(&self) -> Option<Self> {
        let Phase::Running(running) = &self.host else {
            return None;
        };
        let end = Shared::of(self.end.lock().clone());
        let (servo, beat) = running.state();
        Some(Self {
            lab: Arc::clone(&self.lab),
            device: self.device.clone(),
            to_device: self.to_device.clone(),
            to_host: self.to_host.clone(),
            host: Phase::Running(Box::new(Loop::new(
                servo,
                (&end, &self.lab.scene, &self.lab.tools),
                beat,
            ))),
            end,
            heard: self.heard.clone(),
            sent: self.sent.clone(),
            kept: self.kept.clone(),
            ..*self
        })
    }

    /// Makes a fault begin now.
    pub fn inject(&mut self, planned: Planned, seed: u64) {
        let entry = planned.fault.entry();
        match (entry.place, planned.direction) {
            (Where::Sensors, _) => self.device.inject(planned.fault, seed),
            (Where::World, _) => match planned.fault {
                Fault::BrownOut => self.device.brown_out(),
                Fault::Unplug => self.unplug(u64::from(entry.lasts_ms) * MS),
                _ => self.intruder = Some(1),
            },
            (_, Direction::ToDevice) => self.to_device.inject(planned.fault, self.now, seed),
            _ => self.to_host.inject(planned.fault, self.now, seed),
        }
    }

    fn unplug(&mut self, for_ns: u64) {
        self.to_device.clear();
        self.to_host.clear();
        self.end.lock().unplugged = true;
        self.plugged_at = Some(self.now + for_ns);
    }

    /// Goes on to the end of the device's next tick; the truth there.
    pub fn tick(&mut self) -> Truth {
        while self.host_next < self.device_next {
            self.now = self.host_next;
            self.host_next += MS;
            self.host_tick();
        }
        self.now = self.device_next;
        self.device_next += self.device_period;
        self.device_tick()
    }

    fn device_tick(&mut self) -> Truth {
        self.device.simulate();
        let mut bytes = Vec::new();
        self.to_device.take(self.now, &mut bytes);
        let mut out = [0; MAX_FRAME];
        for byte in bytes {
            let answer = self.device.push(byte, &mut out);
            self.to_host.put(self.now, answer);
        }
        let (state, frame) = self.device.tick_frame(&mut out);
        if self.plugged_at.is_none() {
            self.to_host.put(self.now, frame);
        }
        self.check_newest();
        self.device.truth(&state)
    }

    // what the drive works with must be what a host has said, and newer than before
    fn check_newest(&mut self) {
        let newest = self.device.firmware().newest_command();
        if let Some(command) = newest
            && newest != self.newest
        {
            let old = self
                .newest
                .is_some_and(|last| !osteon_protocol::frame::is_newer(command.seq, last.seq));
            if old || self.sent.get(&command.seq) != Some(&command) {
                self.wrongly_applied += 1;
            }
        }
        self.newest = newest;
    }

    fn host_tick(&mut self) {
        if self.plugged_at.is_some_and(|at| self.now >= at) {
            self.plugged_at = None;
            *self.end.lock() = End::default();
            if let Phase::Over(_, servo) = &mut self.host {
                servo.reconnect();
                self.host = Phase::Starting(Start::default(), servo.clone());
            }
        }
        let mut bytes = Vec::new();
        self.to_host.take(self.now, &mut bytes);
        self.end.lock().inbound.extend(bytes);
        let next = match &mut self.host {
            Phase::Over(..) => None,
            Phase::Starting(start, servo) => match start.step(self.now, &mut self.end.lock()) {
                Ok(false) => None,
                Ok(true) => Some(Phase::Running(Box::new(Loop::new(
                    (**servo).clone(),
                    (&self.end, &self.lab.scene, &self.lab.tools),
                    Beat::new(self.now).counting_from(self.first_command),
                )))),
                Err(e) => Some(Phase::Over(e.to_string(), servo.clone())),
            },
            Phase::Running(running) => running.beat(self.now, &mut self.kept).err().map(|ending| {
                let text = ending_text(&ending).unwrap_or_default();
                Phase::Over(text, Box::new(running.state().0))
            }),
        };
        if let Some(next) = next {
            self.host = next;
        }
        let bytes = core::mem::take(&mut self.end.lock().outbound);
        for &byte in &bytes {
            if let Some(Ok(HostMessage::Command(command))) = self.heard.push(byte) {
                self.sent.insert(command.seq, command);
            }
        }
        if self.plugged_at.is_none() {
            self.to_device.put(self.now, &bytes);
            self.intrude();
        }
    }

    // a second program: says hello, then asks for torque
    fn intrude(&mut self) {
        let Some(seq) = self.intruder else {
            return;
        };
        let mut out = [0; MAX_FRAME];
        let message = if seq == 1 {
            HostMessage::HelloRequest {
                version: DEVICE_VERSION,
                schema: DEVICE_SCHEMA,
            }
        } else {
            let command = CommandFrame {
                seq,
                state_seq: 0,
                torque: [500; 3],
                enable: true,
            };
            HostMessage::Command(command)
        };
        self.intruder = Some(seq.saturating_add(1));
        let frame = encode(&message, &mut out).unwrap_or(&[]);
        self.to_device.put(self.now, frame);
    }

    /// Why the session is over, if it is.
    pub fn over(&self) -> Option<&str> {
        match &self.host {
            Phase::Over(why, _) => Some(why),
            _ => None,
        }
    }

    /// From now on every tick of the servo's loop is kept.
    pub(crate) fn keep_ticks(&mut self) {
        self.kept.get_or_insert_default();
    }

    /// The ticks kept so far, taken out.
    pub(crate) fn kept_ticks(&mut self) -> Vec<TickRecord> {
        self.kept.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The servo's cut, whole: every step that began is carved to its end.
    pub(crate) fn cut(&self) -> Cut {
        let mut servo = match &self.host {
            Phase::Starting(_, servo) | Phase::Over(_, servo) => (**servo).clone(),
            Phase::Running(running) => running.state().0,
        };
        servo.finish_carving();
        servo.cut().clone()
    }

    /// Whether the servo's loop runs.
    pub fn running(&self) -> bool {
        matches!(self.host, Phase::Running(_))
    }

    /// Virtual time, ns.
    pub fn now_ns(&self) -> u64 {
        self.now
    }

    /// When the fault met its first frame, ns.
    pub fn met_ns(&self) -> Option<u64> {
        let (up, down) = (&self.to_device, &self.to_host);
        up.first_touched_ns().or(down.first_touched_ns())
    }

    /// The device.
    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Commands that the drive took over although no host had sent them so, or not in their order.
    pub fn wrongly_applied(&self) -> u32 {
        self.wrongly_applied
    }
}
