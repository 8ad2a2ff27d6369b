//! A viewer in this process that keeps a bone of its own, so that it can be looked at afterwards.

use osteon_protocol::ipc::{
    Digest, FromViewer, IPC_VERSION, Join, Role, Scene, ToViewer, capability,
};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into, unpack_bricks, unpack_piece};
use osteon_sim_core::bone::{Bone, ChunkData};
use osteon_sim_core::cut::Cut;
use osteon_sim_core::grid::Grid;
use osteon_sim_core::pose::Pose;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// The first two messages of a viewer.
pub fn hello(name: &str, control: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let hello = FromViewer::Hello {
        version: IPC_VERSION,
        name: name.to_owned(),
    };
    let mut capabilities = capability::ALL;
    if !control {
        capabilities &= !capability::CONTROL;
    }
    let join = FromViewer::Join(Join {
        role: Role::Trainee,
        capabilities,
        pose_hz: 125,
        resume: None,
    });
    for message in [hello, join] {
        // far below the bound
        encode_into(&message, &mut bytes).unwrap_or(());
    }
    bytes
}

/// What came over the socket in one second, and when the picture was whole.
#[derive(Debug, Clone, Default)]
pub struct Traffic {
    /// Seconds from connecting to the whole bone with its cut.
    pub complete_s: Option<f64>,
    /// Bytes of each second after that.
    pub per_second: Vec<u64>,
}

/// The viewer.
#[derive(Debug)]
pub struct Follower {
    socket: PathBuf,
    bone: Option<Bone>,
    chunks: usize,
    cut: Option<Cut>,
    // bricks taken over
    bricks: u64,
    answered: Option<Digest>,
    began: Instant,
    /// What it measured.
    pub traffic: Traffic,
}

impl Follower {
    /// Not yet connected.
    pub fn new(socket: &Path) -> Self {
        Self {
            socket: socket.to_owned(),
            bone: None,
            chunks: 0,
            cut: None,
            bricks: 0,
            answered: None,
            began: Instant::now(),
            traffic: Traffic::default(),
        }
    }

    /// Follows the session to its end, reading only while `awake(age)`; the final cut.
    pub fn run(mut self, awake: impl Fn(Duration) -> bool) -> Option<Cut> {
        self.follow(&awake, None);
        self.cut
    }

    /// Follows the session to its end; the digest of the own bone, once it was asked for.
    pub fn digest_at_the_end(mut self) -> Option<Digest> {
        self.follow(&|_| true, None);
        self.answered
    }

    /// Follows and measures until an instant; what came.
    pub fn measure_until(mut self, until: Instant) -> Traffic {
        self.follow(&|_| true, Some(until));
        self.traffic
    }

    /// Lives until an instant, and is gone without a word.
    pub fn live_until(mut self, until: Instant) {
        self.follow(&|_| true, Some(until));
    }

    fn follow(&mut self, awake: &dyn Fn(Duration) -> bool, until: Option<Instant>) {
        let Ok(mut stream) = UnixStream::connect(&self.socket) else {
            std::thread::sleep(Duration::from_millis(10));
            return;
        };
        self.began = Instant::now();
        let short = Some(Duration::from_millis(20));
        if stream.set_read_timeout(short).is_err()
            || stream.write_all(&hello("follower", false)).is_err()
        {
            return;
        }
        let mut decoder = StreamDecoder::new();
        let mut buffer = vec![0; 65_536];
        while until.is_none_or(|t| Instant::now() < t) {
            if !awake(self.began.elapsed()) {
                std::thread::sleep(Duration::from_millis(5));
                continue;
            }
            match stream.read(&mut buffer) {
                Ok(0) => return,
                Ok(n) => {
                    self.count(n);
                    decoder.push(&buffer[..n]);
                }
                Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                    continue;
                }
                Err(_) => return,
            }
            while let Ok(Some(message)) = decoder.next::<ToViewer>() {
                if let Some(answer) = self.take(message) {
                    let mut bytes = Vec::new();
                    if encode_into(&answer, &mut bytes).is_err()
                        || stream.write_all(&bytes).is_err()
                    {
                        return;
                    }
                }
            }
        }
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "seconds of a session"
    )]
    fn count(&mut self, bytes: usize) {
        let Some(complete) = self.traffic.complete_s else {
            return;
        };
        let second = (self.began.elapsed().as_secs_f64() - complete) as usize;
        if self.traffic.per_second.len() <= second {
            self.traffic.per_second.resize(second + 1, 0);
        }
        self.traffic.per_second[second] += bytes as u64;
    }

    fn take(&mut self, message: ToViewer) -> Option<FromViewer> {
        match message {
            ToViewer::Scene(scene) => self.begin(&scene),
            ToViewer::BonePiece(piece) => {
                let bone = self.bone.as_mut()?;
                let values = unpack_piece(&piece).ok()?;
                let data = ChunkData {
                    density_hu: &values.density_hu,
                    solid: &values.solid,
                    class: &values.class,
                    label: &values.label,
                };
                bone.push_chunk(piece.coord, piece.bony, &data).ok()?;
                if bone.chunk_count() == self.chunks {
                    self.cut = Some(Cut::new(bone));
                }
            }
            ToViewer::Reset { epoch } => self.cut.as_mut()?.reset(epoch),
            ToViewer::Undone { epoch, .. } => self.cut.as_mut()?.set_epoch(epoch),
            ToViewer::Bricks(bricks) => {
                let cut = self.cut.as_mut()?;
                let values = unpack_bricks(&bricks).ok()?;
                for ((chunk, brick), v) in bricks.ids.iter().zip(values.chunks(512)) {
                    cut.set_brick(*chunk as usize, usize::from(*brick), v);
                }
                self.bricks += bricks.ids.len() as u64;
            }
            // health comes after what is owed: the picture is whole
            ToViewer::Health(_) if self.cut.is_some() && self.traffic.complete_s.is_none() => {
                self.traffic.complete_s = Some(self.began.elapsed().as_secs_f64());
            }
            ToViewer::Digest(asked) => return self.answer(asked),
            _ => {}
        }
        None
    }

    fn begin(&mut self, scene: &Scene) {
        let dims = scene.dims.map(|n| n as usize);
        let grid = Grid::new(dims, scene.spacing_mm.into()).ok();
        self.bone = grid.map(|grid| Bone::new(grid, Pose::IDENTITY));
        self.chunks = scene.chunks as usize;
        self.cut = None;
    }

    fn answer(&mut self, asked: Digest) -> Option<FromViewer> {
        let (cut, bone) = (self.cut.as_mut()?, self.bone.as_ref()?);
        cut.set_revision(asked.revision);
        let own = cut.digest(bone);
        let digest = Digest {
            epoch: own.epoch,
            revision: own.revision,
            hash: own.hash,
            changed_chunks: own.changed_chunks,
        };
        self.answered = Some(digest);
        Some(FromViewer::Digest {
            digest,
            frames_rendered: 0,
            updates: self.bricks,
            resyncs: 1,
        })
    }
}
