//! The viewer link over a network: mutually authenticated and encrypted, without I/O of its own.
//!
//! Noise `IK` with X25519, ChaCha20-Poly1305 and BLAKE2s, by the crate `snow`: the viewer knows the
//! haptics process's public key beforehand, the haptics process a list of viewers' keys. Both messages
//! of the handshake have a fixed length, so there is nothing in them to parse; what comes after is
//! records that are authenticated before a byte of them reaches another decoder. See `WIRE.md`, part 4.

use snow::params::{DHChoice, NoiseParams};
use snow::resolvers::{CryptoResolver as _, DefaultResolver};
use snow::{Builder, HandshakeState, StatelessTransportState};
use std::sync::Arc;

/// The pattern, as Noise names it.
const PATTERN: &str = "Noise_IK_25519_ChaChaPoly_BLAKE2s";
/// Bound into the handshake: another protocol, or another revision of this one, fails it.
const PROLOGUE: &[u8] = b"osteon viewer link over noise 1";

/// Bytes of the viewer's first message: ephemeral key 32, static key 32 + 16, empty payload 16.
pub const CALL_BYTES: usize = 96;
/// Bytes of the answer: ephemeral key 32, empty payload 16.
pub const ANSWER_BYTES: usize = 48;
/// Most bytes of plaintext in a record.
pub const MAX_RECORD: usize = 16_384;
/// Bytes of a record's tag.
const TAG: usize = 16;
/// Bytes of a record's length.
const LENGTH: usize = 2;
/// Most bytes of a record on the wire.
pub const MAX_SEALED: usize = LENGTH + MAX_RECORD + TAG;

/// Why a handshake or a record was refused. Nothing more is told to the other side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SecureError {
    /// The system has no random numbers, or a key is not one.
    Key,
    /// The handshake does not open with the keys at hand.
    Handshake,
    /// The other side's key is not trusted.
    Stranger,
    /// A record is not authentic, or has an impossible length.
    Record,
}

impl core::fmt::Display for SecureError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Key => "a key that is none",
            Self::Handshake => "a handshake that does not open with the keys at hand",
            Self::Stranger => "a key that is not trusted",
            Self::Record => "a record that is not authentic",
        })
    }
}

impl core::error::Error for SecureError {}

/// A public key, X25519.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct PublicKey(pub [u8; 32]);

impl PublicKey {
    /// 64 hexadecimal digits.
    pub fn to_hex(self) -> String {
        hex(&self.0)
    }

    /// The reverse of [`Self::to_hex`]; `None` for any other text.
    pub fn from_hex(text: &str) -> Option<Self> {
        unhex(text).map(Self)
    }
}

/// A private key with its public one. Never shown by `Debug`.
#[derive(Clone, PartialEq, Eq)]
pub struct Identity {
    secret: [u8; 32],
    public: PublicKey,
}

impl core::fmt::Debug for Identity {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Identity")
            .field("public", &self.public)
            .finish_non_exhaustive()
    }
}

impl Identity {
    /// A new one, from the system's random numbers.
    pub fn generate() -> Result<Self, SecureError> {
        let pair = builder()?.generate_keypair();
        let pair = pair.map_err(|_refused| SecureError::Key)?;
        let secret = <[u8; 32]>::try_from(pair.private);
        Self::from_secret(secret.map_err(|_other_length| SecureError::Key)?)
    }

    /// Around a private key.
    pub fn from_secret(secret: [u8; 32]) -> Result<Self, SecureError> {
        let mut dh = DefaultResolver
            .resolve_dh(&DHChoice::Curve25519)
            .ok_or(SecureError::Key)?;
        dh.set(&secret);
        let public = <[u8; 32]>::try_from(dh.pubkey());
        let public = PublicKey(public.map_err(|_other_length| SecureError::Key)?);
        Ok(Self { secret, public })
    }

    /// What others need to know of it.
    pub fn public(&self) -> PublicKey {
        self.public
    }

    /// The private key as 64 hexadecimal digits, for its file.
    pub fn secret_hex(&self) -> String {
        hex(&self.secret)
    }

    /// The reverse of [`Self::secret_hex`].
    pub fn from_secret_hex(text: &str) -> Option<Self> {
        unhex(text).and_then(|secret| Self::from_secret(secret).ok())
    }
}

/// The viewer's side of a handshake under way.
#[derive(Debug)]
pub struct Call(HandshakeState);

impl Call {
    /// Begins: the bytes to send.
    pub fn begin(
        own: &Identity,
        theirs: PublicKey,
    ) -> Result<(Self, [u8; CALL_BYTES]), SecureError> {
        let state = builder()?
            .local_private_key(&own.secret)
            .and_then(|b| b.remote_public_key(&theirs.0))
            .and_then(Builder::build_initiator);
        let mut state = state.map_err(|_refused| SecureError::Key)?;
        let mut call = [0; CALL_BYTES];
        match state.write_message(&[], &mut call) {
            Ok(CALL_BYTES) => Ok((Self(state), call)),
            _ => Err(SecureError::Handshake),
        }
    }

    /// Ends: only the owner of the key that was called can have made the answer.
    pub fn end(mut self, answer: &[u8; ANSWER_BYTES]) -> Result<(Sealer, Opener), SecureError> {
        match self.0.read_message(answer, &mut []) {
            Ok(0) => halves(self.0),
            _ => Err(SecureError::Handshake),
        }
    }
}

/// What came of a call that was answered.
#[derive(Debug)]
pub struct Answered {
    /// Bytes to send.
    pub answer: [u8; ANSWER_BYTES],
    /// Who called. Proven only by the first record that opens: the call alone may be a repetition.
    pub caller: PublicKey,
    /// For what goes out.
    pub sealer: Sealer,
    /// For what comes in.
    pub opener: Opener,
}

/// The haptics process's side: answers a call of somebody who is trusted.
pub fn answer(
    own: &Identity,
    call: &[u8; CALL_BYTES],
    trusted: impl Fn(PublicKey) -> bool,
) -> Result<Answered, SecureError> {
    let state = builder()?
        .local_private_key(&own.secret)
        .and_then(Builder::build_responder);
    let mut state = state.map_err(|_refused| SecureError::Key)?;
    if !matches!(state.read_message(call, &mut []), Ok(0)) {
        return Err(SecureError::Handshake);
    }
    let caller = state.get_remote_static().ok_or(SecureError::Handshake)?;
    let caller = <[u8; 32]>::try_from(caller);
    let caller = PublicKey(caller.map_err(|_other_length| SecureError::Handshake)?);
    if !trusted(caller) {
        return Err(SecureError::Stranger);
    }
    let mut answer = [0; ANSWER_BYTES];
    if !matches!(state.write_message(&[], &mut answer), Ok(ANSWER_BYTES)) {
        return Err(SecureError::Handshake);
    }
    let (sealer, opener) = halves(state)?;
    Ok(Answered {
        answer,
        caller,
        sealer,
        opener,
    })
}

fn builder() -> Result<Builder<'static>, SecureError> {
    let params: NoiseParams = PATTERN.parse().map_err(|_unknown| SecureError::Key)?;
    let builder = Builder::new(params).prologue(PROLOGUE);
    builder.map_err(|_refused| SecureError::Key)
}

fn halves(state: HandshakeState) -> Result<(Sealer, Opener), SecureError> {
    let state = state.into_stateless_transport_mode();
    let state = Arc::new(state.map_err(|_unfinished| SecureError::Handshake)?);
    let sealer = Sealer {
        state: Arc::clone(&state),
        nonce: 0,
    };
    let opener = Opener {
        state,
        nonce: 0,
        bytes: Vec::new(),
    };
    Ok((sealer, opener))
}

/// Makes records: length of the rest u16 LE, ciphertext, tag.
#[derive(Debug)]
pub struct Sealer {
    state: Arc<StatelessTransportState>,
    nonce: u64,
}

impl Sealer {
    /// Appends a record of the first [`MAX_RECORD`] bytes of `plain` to `out`; how many those were.
    pub fn seal(&mut self, plain: &[u8], out: &mut Vec<u8>) -> Result<usize, SecureError> {
        let count = plain.len().min(MAX_RECORD);
        let begin = out.len();
        let sealed = count + TAG;
        out.resize(begin + LENGTH + sealed, 0);
        let length = u16::try_from(sealed).map_err(|_too_long| SecureError::Record)?;
        out[begin..begin + LENGTH].copy_from_slice(&length.to_le_bytes());
        let body = &mut out[begin + LENGTH..];
        let written = self.state.write_message(self.nonce, &plain[..count], body);
        self.nonce += 1;
        match written {
            Ok(n) if n == sealed => Ok(count),
            _ => {
                out.truncate(begin);
                Err(SecureError::Record)
            }
        }
    }
}

/// Opens records in their order; each may come once.
#[derive(Debug)]
pub struct Opener {
    state: Arc<StatelessTransportState>,
    nonce: u64,
    // of a record that is not whole yet; at most [`MAX_SEALED`]
    bytes: Vec<u8>,
}

impl Opener {
    /// Bytes that can be pushed before [`Self::next`] must be asked.
    pub fn room(&self) -> usize {
        MAX_SEALED - self.bytes.len()
    }

    /// Takes bytes of the stream, at most [`Self::room`]; more are not looked at.
    pub fn push(&mut self, bytes: &[u8]) {
        let most = bytes.len().min(self.room());
        self.bytes.extend_from_slice(&bytes[..most]);
    }

    /// Appends the next whole record's plaintext to `plain`; false when more bytes are needed. An
    /// error is final.
    pub fn next(&mut self, plain: &mut Vec<u8>) -> Result<bool, SecureError> {
        let Some((length, rest)) = self.bytes.split_first_chunk::<LENGTH>() else {
            return Ok(false);
        };
        let length = usize::from(u16::from_le_bytes(*length));
        // no record is empty: one without a byte would only keep us busy
        if !(TAG + 1..=MAX_RECORD + TAG).contains(&length) {
            return Err(SecureError::Record);
        }
        let Some(sealed) = rest.get(..length) else {
            return Ok(false);
        };
        let begin = plain.len();
        plain.resize(begin + length - TAG, 0);
        let opened = self
            .state
            .read_message(self.nonce, sealed, &mut plain[begin..]);
        if !matches!(opened, Ok(n) if n == length - TAG) {
            plain.truncate(begin);
            return Err(SecureError::Record);
        }
        self.nonce += 1;
        self.bytes.drain(..LENGTH + length);
        Ok(true)
    }
}

fn hex(bytes: &[u8; 32]) -> String {
    const DIGITS: &[u8; 16] = b"0123456789abcdef";
    bytes
        .iter()
        .flat_map(|b| [b >> 4, b & 15])
        .map(|nibble| char::from(DIGITS[usize::from(nibble)]))
        .collect()
}

fn unhex(text: &str) -> Option<[u8; 32]> {
    let (pairs, []) = text.as_bytes().as_chunks::<2>() else {
        return None;
    };
    let digit = |c: u8| {
        char::from(c)
            .to_digit(16)
            .and_then(|d| u8::try_from(d).ok())
    };
    let bytes: Option<Vec<u8>> = pairs
        .iter()
        .map(|&[high, low]| Some(digit(high)? << 4 | digit(low)?))
        .collect();
    bytes?.try_into().ok()
}
