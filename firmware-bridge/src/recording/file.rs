//! The session file: MCAP with the messages of a replay in postcard, and what people look at in JSON.

use super::readable::{self, FORCE, Readable};
use super::sink::{Sink, State, Storage};
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{McapError, WriteOptions, Writer};
use osteon_protocol::session::{self, MARK_TOPIC, Mark, SETUP_TOPIC, Setup, TICK_TOPIC, Tick};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::Write as _;

/// Bytes of a chunk at most; a flush ends it sooner.
const CHUNK_BYTES: u64 = 1 << 20;

/// A session file that is being written.
pub(super) struct SessionFile {
    writer: Writer<NoSeek<Sink>>,
    channels: Channels,
    sequence: BTreeMap<u16, u32>,
    began_unix_ns: u64,
    bytes: Vec<u8>,
    readable: Readable,
}

#[derive(Debug, Clone, Copy)]
struct Channels {
    setup: u16,
    tick: u16,
    mark: u16,
    readable: [u16; readable::TOPICS.len()],
}

impl SessionFile {
    /// Begins a file: its setup and its channels.
    pub(super) fn begin(
        file: Box<dyn Storage>,
        state: State,
        setup: &Setup,
    ) -> Result<Self, McapError> {
        let options = WriteOptions::new()
            .compression(None)
            .profile("osteon")
            .library(format!("osteon {}", env!("CARGO_PKG_VERSION")))
            .chunk_size(Some(CHUNK_BYTES))
            .disable_seeking(true);
        let mut writer = Writer::with_options(NoSeek::new(Sink::new(file, state)), options)?;
        writer.write_metadata(&Metadata {
            name: "osteon".to_owned(),
            metadata: about(setup),
        })?;
        let none = BTreeMap::new();
        let mut exact = |topic| writer.add_channel(0, topic, "postcard", &none);
        let (setup_channel, tick, mark) =
            (exact(SETUP_TOPIC)?, exact(TICK_TOPIC)?, exact(MARK_TOPIC)?);
        let mut shown = [0; readable::TOPICS.len()];
        for (channel, topic) in shown.iter_mut().zip(readable::TOPICS) {
            let schema = writer.add_schema(topic.schema, "jsonschema", topic.json.as_bytes())?;
            *channel = writer.add_channel(schema, topic.topic, "json", &none)?;
        }
        let mut own = Self {
            writer,
            channels: Channels {
                setup: setup_channel,
                tick,
                mark,
                readable: shown,
            },
            sequence: BTreeMap::new(),
            began_unix_ns: setup.began_unix_ns,
            bytes: Vec::new(),
            readable: Readable::default(),
        };
        own.put(own.channels.setup, 0, setup)?;
        own.flush()?;
        Ok(own)
    }

    /// A tick, and what there is to show of it.
    pub(super) fn tick(&mut self, tick: &Tick) -> Result<(), McapError> {
        self.put(self.channels.tick, tick.started_ns, tick)?;
        let mut readable = core::mem::take(&mut self.readable);
        let shown = readable.of_tick(tick);
        self.readable = readable;
        for (topic, json) in shown {
            self.show(topic, tick.started_ns, &json)?;
        }
        Ok(())
    }

    pub(super) fn mark(&mut self, at_ns: u64, mark: &Mark) -> Result<(), McapError> {
        self.put(self.channels.mark, at_ns, mark)
    }

    /// A message for people.
    pub(super) fn show(
        &mut self,
        topic: usize,
        at_ns: u64,
        json: &serde_json::Value,
    ) -> Result<(), McapError> {
        let text = json.to_string();
        self.write(self.channels.readable[topic], at_ns, text.as_bytes())
    }

    fn put<T: Serialize>(&mut self, channel: u16, at_ns: u64, it: &T) -> Result<(), McapError> {
        let mut bytes = core::mem::take(&mut self.bytes);
        // fails for no message of ours: none has a shape that postcard lacks
        if session::encode(it, &mut bytes).is_ok() {
            self.write(channel, at_ns, &bytes)?;
        }
        self.bytes = bytes;
        Ok(())
    }

    fn write(&mut self, channel_id: u16, at_ns: u64, data: &[u8]) -> Result<(), McapError> {
        let sequence = self.sequence.entry(channel_id).or_default();
        *sequence = sequence.wrapping_add(1);
        let time = self.began_unix_ns.saturating_add(at_ns);
        let header = MessageHeader {
            channel_id,
            sequence: *sequence,
            log_time: time,
            publish_time: time,
        };
        self.writer.write_to_known_channel(&header, data)
    }

    /// Ends the chunk and hands all to the system: a process that is killed after it loses nothing of it.
    pub(super) fn flush(&mut self) -> Result<(), McapError> {
        self.writer.flush()
    }

    /// Writes the index and the end.
    pub(super) fn finish(mut self) -> Result<(), McapError> {
        if let Some((at_ns, force)) = self.readable.rest() {
            self.show(FORCE, at_ns, &force)?;
        }
        self.writer.finish()?;
        Ok(self.writer.into_inner().flush()?)
    }
}

/// What any tool shows of the file.
fn about(setup: &Setup) -> BTreeMap<String, String> {
    let mut about = BTreeMap::new();
    let mut say = |key: &str, value: String| about.insert(key.to_owned(), value);
    say("software", setup.software.clone());
    say(
        "bone",
        setup
            .scene
            .bone
            .clone()
            .unwrap_or_else(|| "built-in phantom".to_owned()),
    );
    say("bone_xxh3", format!("{:016x}", setup.bone_hash));
    for (id, hash) in &setup.tool_hashes {
        say(&format!("tool_{id}_xxh3"), format!("{hash:016x}"));
    }
    say("device", setup.device.link.clone());
    say("force_limit_n", setup.force_limit_n.to_string());
    say("tick_s", setup.tick_s.to_string());
    say(
        "frames",
        "poses a_from_b, mm; bone frame along the lattice; quaternions x, y, z, w".to_owned(),
    );
    about
}
