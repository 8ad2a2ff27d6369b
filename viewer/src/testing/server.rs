//! A haptics process of one thread: it says what it is told to and keeps what it hears.

use interprocess::local_socket::{
    GenericFilePath, Listener, ListenerOptions, Stream, ToFsName as _, traits::Listener as _,
};
use osteon_protocol::ipc::{Digest, FromViewer, IPC_VERSION, ToViewer};
use osteon_protocol::ipc_frame::{StreamDecoder, encode_into};
use std::io::{Read as _, Write as _};
use std::path::PathBuf;
use std::thread::JoinHandle;

/// What the thread does with a connection.
pub(crate) type Script = Box<dyn FnOnce(&mut Talk) + Send>;
/// What the thread does with each of several connections, one after the other.
pub(crate) type Scripts = Box<dyn FnMut(&mut Talk) + Send>;

pub(crate) struct Server {
    pub(crate) socket: PathBuf,
    // removed with the server
    folder: PathBuf,
    thread: Option<JoinHandle<()>>,
}

pub(crate) struct Talk {
    stream: Stream,
    decoder: StreamDecoder,
}

impl Server {
    /// Listens on a socket of its own for one viewer.
    pub(crate) fn start(name: &str, script: Script) -> Self {
        let mut script = Some(script);
        let once: Scripts = Box::new(move |talk| {
            if let Some(script) = script.take() {
                script(talk);
            }
        });
        Self::start_for(name, 1, once)
    }

    /// Listens on a socket of its own for `connections` of one viewer.
    pub(crate) fn start_for(name: &str, connections: usize, mut script: Scripts) -> Self {
        let folder =
            std::env::temp_dir().join(format!("osteon-viewer-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let socket = folder.join("s");
        let path = socket.as_path().to_fs_name::<GenericFilePath>().unwrap();
        let listener: Listener = ListenerOptions::new().name(path).create_sync().unwrap();
        let thread = std::thread::Builder::new().spawn(move || {
            for _ in 0..connections {
                let stream = listener.accept().unwrap();
                script(&mut Talk {
                    stream,
                    decoder: StreamDecoder::new(),
                });
            }
        });
        Self {
            socket,
            folder,
            thread: Some(thread.unwrap()),
        }
    }

    /// Waits for the script's end and hands on its panic.
    pub(crate) fn join(mut self) {
        if let Some(Err(panic)) = self.thread.take().map(JoinHandle::join) {
            std::panic::resume_unwind(panic);
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(std::fs::remove_dir_all(&self.folder));
    }
}

impl Talk {
    pub(crate) fn send(&mut self, message: &ToViewer) {
        let mut bytes = Vec::new();
        encode_into(message, &mut bytes).unwrap();
        self.stream.write_all(&bytes).unwrap();
    }

    pub(crate) fn send_bytes(&mut self, bytes: &[u8]) {
        self.stream.write_all(bytes).unwrap();
    }

    pub(crate) fn hello(&mut self) {
        self.send(&ToViewer::Hello {
            version: IPC_VERSION,
        });
    }

    pub(crate) fn bye(&mut self) {
        self.send(&ToViewer::Bye {
            reason: "done".into(),
        });
    }

    /// Next message of the viewer.
    pub(crate) fn hear(&mut self) -> FromViewer {
        loop {
            if let Some(message) = self.decoder.next().unwrap() {
                return message;
            }
            let mut bytes = [0; 4096];
            let count = self.stream.read(&mut bytes).unwrap();
            assert!(count > 0, "the viewer hung up");
            self.decoder.push(&bytes[..count]);
        }
    }

    /// Asks for the viewer's digest.
    pub(crate) fn digest(&mut self, own: Digest) -> Digest {
        self.send(&ToViewer::Digest(own));
        loop {
            if let FromViewer::Digest { digest, .. } = self.hear() {
                return digest;
            }
        }
    }
}
