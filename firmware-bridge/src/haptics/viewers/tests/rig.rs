//! A haptics process's side without a servo, and a viewer that does what WIRE.md asks.

use super::super::*;
use glam::DVec3;
use osteon_protocol::ipc::{Role, Welcome, WirePose};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into, unpack_bricks};
use osteon_sim_core::bone::{Bone, DenseBone};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use osteon_sim_core::tissue::Tissue;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;

/// A block of bone of 2 × 2 × 2 chunks.
pub(super) fn block() -> Arc<Bone> {
    let grid = Grid::new([64; 3], DVec3::splat(0.5)).expect("a lattice");
    let dense = DenseBone {
        density_hu: &vec![800; grid.len()],
        solid_mm: &vec![3.0; grid.len()],
        class: &vec![Tissue::Cancellous as u8; grid.len()],
        label: &vec![1; grid.len()],
    };
    Arc::new(Bone::from_dense(grid, Pose::IDENTITY, &dense).expect("a bone"))
}

pub(super) fn scene() -> Scene {
    let pose = WirePose {
        rotation: [0.0, 0.0, 0.0, 1.0],
        translation_mm: [0.0; 3],
    };
    Scene {
        source: "a block".into(),
        dims: [64; 3],
        spacing_mm: [0.5; 3],
        lps_from_bone: pose,
        bone_from_plan: pose,
        chunks: 8,
        solid_mm3: 1.0,
        tools: Vec::new(),
        force_limit_n: 3.3,
        force_scale: 0.05,
    }
}

/// The haptics process's side.
pub(super) struct Rig {
    pub(super) viewers: Viewers,
    pub(super) mirror: Mirror,
    pub(super) scene: Scene,
    pub(super) pose: Option<PoseUpdate>,
}

impl Rig {
    pub(super) fn new() -> Self {
        let mirror = Mirror::new(block(), Vec::new());
        Self {
            viewers: Viewers::new(mirror.bone.chunk_count()),
            mirror,
            scene: scene(),
            pose: None,
        }
    }

    pub(super) fn visit(&mut self) -> Vec<Command> {
        self.ask(None)
    }

    pub(super) fn ask(&mut self, final_digest: Option<Digest>) -> Vec<Command> {
        self.viewers.visit(&Facts {
            scene: &self.scene,
            mirror: &self.mirror,
            pose: self.pose,
            health: None,
            final_digest,
        })
    }

    /// Cuts a brick to a value.
    pub(super) fn cut(&mut self, chunk: usize, brick: usize, value: i16) {
        assert!(self.mirror.cut.set_brick(chunk, brick, &[value; 512]));
        self.mirror.cut.set_revision(self.mirror.cut.revision() + 1);
        self.viewers.mark(chunk, brick);
    }

    pub(super) fn digest(&self) -> Digest {
        crate::haptics::publisher::wire_digest(self.mirror.cut.digest(&self.mirror.bone))
    }

    /// A new connection.
    pub(super) fn door(&mut self) -> UnixStream {
        let (ours, theirs) = UnixStream::pair().expect("a pair");
        for end in [&ours, &theirs] {
            end.set_nonblocking(true).expect("a mode");
        }
        self.viewers.admit(Box::new(ours), Peer::Local);
        theirs
    }
}

pub(super) fn join_as(role: Role, capabilities: u32, resume: Option<Resume>) -> Join {
    Join {
        role,
        capabilities,
        pose_hz: 250,
        resume,
    }
}

/// The viewer's side: what WIRE.md asks of it.
pub(super) struct Fake {
    pub(super) stream: UnixStream,
    pub(super) decoder: StreamDecoder,
    pub(super) welcome: Option<Welcome>,
    pub(super) control: Option<ControlState>,
    pub(super) denied: Option<String>,
    pub(super) pieces: u32,
    pub(super) batches: u64,
    pub(super) cut: Cut,
    pub(super) bone: Arc<Bone>,
    // counted since the connection began
    pub(super) heard: Heard,
}

#[derive(Default)]
pub(super) struct Heard {
    pub(super) scenes: u32,
    pub(super) pieces: u32,
    pub(super) bricks: usize,
    pub(super) poses: u32,
    pub(super) removals: Vec<RemovalEvent>,
}

impl Fake {
    pub(super) fn connect(rig: &mut Rig, join: Join) -> Self {
        let bone = Arc::clone(&rig.mirror.bone);
        let mut fake = Self {
            stream: rig.door(),
            decoder: StreamDecoder::new(),
            welcome: None,
            control: None,
            denied: None,
            pieces: 0,
            batches: 0,
            cut: Cut::new(&bone),
            bone,
            heard: Heard::default(),
        };
        fake.greet(IPC_VERSION, join);
        fake
    }

    pub(super) fn new(rig: &mut Rig, role: Role) -> Self {
        Self::connect(rig, join_as(role, capability::ALL, None))
    }

    /// Greets and hears everything.
    pub(super) fn settled(rig: &mut Rig, role: Role) -> Self {
        let mut fake = Self::new(rig, role);
        fake.settle(rig);
        fake
    }

    pub(super) fn greet(&mut self, version: u16, join: Join) {
        let name = "fake".to_owned();
        self.say(&FromViewer::Hello { version, name });
        self.say(&FromViewer::Join(join));
    }

    pub(super) fn say(&mut self, message: &FromViewer) {
        let mut bytes = Vec::new();
        encode_into(message, &mut bytes).expect("a message");
        self.stream.write_all(&bytes).expect("sent");
    }

    pub(super) fn wish(&mut self, command: Command) {
        self.say(&FromViewer::Command(command));
    }

    /// Hears at most `most` messages, poses apart; how many there were.
    pub(super) fn hear(&mut self, most: usize) -> usize {
        let mut buffer = vec![0; 65_536];
        let mut count = 0;
        while count < most {
            if let Some(message) = self.decoder.next::<ToViewer>().expect("valid") {
                // poses never end
                count += usize::from(!matches!(message, ToViewer::Pose(_)));
                self.take(message);
                continue;
            }
            match self.stream.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => self.decoder.push(&buffer[..n]),
                Err(e) if e.kind() == ErrorKind::WouldBlock => break,
                Err(e) => panic!("{e}"),
            }
        }
        count
    }

    pub(super) fn settle(&mut self, rig: &mut Rig) -> Vec<Command> {
        let mut wishes = Vec::new();
        let mut quiet = 0;
        while quiet < 3 {
            wishes.extend(rig.visit());
            if self.hear(usize::MAX) == 0 {
                quiet += 1;
                // longer in all than a round of bricks
                std::thread::sleep(Duration::from_millis(15));
            } else {
                quiet = 0;
            }
        }
        wishes
    }

    pub(super) fn take(&mut self, message: ToViewer) {
        match message {
            ToViewer::Welcome(welcome) => self.welcome = Some(welcome),
            ToViewer::Scene(_) => {
                self.heard.scenes += 1;
                (self.pieces, self.batches) = (0, 0);
                self.cut = Cut::new(&self.bone);
            }
            ToViewer::BonePiece(piece) => {
                assert_eq!(piece.chunk, self.pieces, "in order");
                self.pieces += 1;
                self.heard.pieces += 1;
            }
            ToViewer::Bricks(bricks) => {
                self.batches += 1;
                self.heard.bricks += bricks.ids.len();
                let values = unpack_bricks(&bricks).expect("bricks");
                for ((chunk, brick), v) in bricks.ids.iter().zip(values.chunks(512)) {
                    assert!(self.cut.set_brick(*chunk as usize, usize::from(*brick), v));
                }
            }
            ToViewer::Reset { epoch } => self.cut.reset(epoch),
            ToViewer::Undone { epoch, .. } => self.cut.set_epoch(epoch),
            ToViewer::Control(state) => self.control = Some(state),
            ToViewer::Denied { reason } | ToViewer::Refused { reason } => {
                self.denied = Some(reason);
            }
            ToViewer::Pose(_) => self.heard.poses += 1,
            ToViewer::Removals(events) => self.heard.removals.extend(events),
            ToViewer::Digest(asked) => {
                let digest = self.digest(asked.revision);
                self.say(&FromViewer::Digest {
                    digest,
                    frames_rendered: 0,
                    updates: 0,
                    resyncs: 0,
                });
            }
            ToViewer::Hello { .. } | ToViewer::Health(_) | ToViewer::Bye { .. } => {}
        }
    }

    pub(super) fn digest(&mut self, revision: u64) -> Digest {
        self.cut.set_revision(revision);
        crate::haptics::publisher::wire_digest(self.cut.digest(&self.bone))
    }

    /// Breaks the connection with all that is unread, and comes back to its seat.
    pub(super) fn come_back(&mut self, rig: &mut Rig) {
        let welcome = self.welcome.expect("a seat");
        let resume = Resume {
            session: welcome.session,
            seat: welcome.seat,
            pieces: self.pieces,
            batches: self.batches,
            epoch: self.cut.epoch(),
        };
        self.stream = rig.door();
        self.decoder = StreamDecoder::new();
        self.heard = Heard::default();
        self.greet(
            IPC_VERSION,
            join_as(Role::Trainee, capability::ALL, Some(resume)),
        );
    }

    pub(super) fn holder(&self) -> Option<u16> {
        self.control.as_ref().and_then(|c| c.holder)
    }

    pub(super) fn number(&self) -> u16 {
        self.welcome.expect("welcome").number
    }

    pub(super) fn assert_same_as(&mut self, rig: &Rig) {
        let theirs = rig.digest();
        assert_eq!(self.digest(theirs.revision), theirs);
    }
}

pub(super) fn removal(revision: u64) -> RemovalEvent {
    let pose = scene().bone_from_plan;
    RemovalEvent {
        tick: revision,
        epoch: 0,
        revision,
        tool: 0,
        bone_from_tool_before: pose,
        bone_from_tool_after: pose,
        removed_mm3_by_class: [revision as f64; 8],
    }
}

pub(super) fn pose() -> PoseUpdate {
    let at = scene().bone_from_plan;
    PoseUpdate {
        tick: 1,
        tool: 0,
        spindle_on: true,
        paused: false,
        clutched: false,
        saturated: false,
        bone_from_tool: at,
        bone_from_device: at,
        force_n: [0.0; 3],
        physical_force_n: 0.0,
        vibration_n: 0.0,
        spindle_rpm: 0.0,
        spindle_nmm: 0.0,
        spindle_load: 0.0,
        motion_scale: 1.0,
        depth_mm: 0.0,
        removed_mm3: 0.0,
        checkpoints: 0,
    }
}
