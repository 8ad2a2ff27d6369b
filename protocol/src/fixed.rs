//! Three integers at fixed width, little endian, for `#[serde(with)]` on the device link.

/// `[i32; 3]` as 12 bytes.
pub(crate) mod i32x3 {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "the signature that serde asks for"
    )]
    pub(crate) fn serialize<S: Serializer>(v: &[i32; 3], to: S) -> Result<S::Ok, S::Error> {
        v.map(i32::to_le_bytes).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[i32; 3], D::Error> {
        Ok(<[[u8; 4]; 3]>::deserialize(from)?.map(i32::from_le_bytes))
    }
}

/// `[i16; 3]` as 6 bytes.
pub(crate) mod i16x3 {
    use serde::{Deserialize as _, Deserializer, Serialize as _, Serializer};

    #[expect(
        clippy::trivially_copy_pass_by_ref,
        reason = "the signature that serde asks for"
    )]
    pub(crate) fn serialize<S: Serializer>(v: &[i16; 3], to: S) -> Result<S::Ok, S::Error> {
        v.map(i16::to_le_bytes).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<[i16; 3], D::Error> {
        Ok(<[[u8; 2]; 3]>::deserialize(from)?.map(i16::from_le_bytes))
    }
}
