//! Files written here byte by byte from the published layout, read back through the reader.

use super::*;
use std::io::Write as _;

/// What a test file says; written by [`Spec::bytes`].
#[derive(Debug, Clone)]
pub(crate) struct Spec {
    pub(crate) dim: [i16; 8],
    pub(crate) datatype: i16,
    pub(crate) big_endian: bool,
    pub(crate) pixdim: [f32; 4],
    pub(crate) slope: f32,
    pub(crate) intercept: f32,
    pub(crate) qform: Option<[f32; 6]>,
    pub(crate) sform: Option<[[f32; 4]; 3]>,
    pub(crate) units: u8,
    pub(crate) values: Vec<f64>,
}

impl Spec {
    /// A volume of 16-bit integers at RAS offset (10, 20, 30), lattice right-handed.
    pub(crate) fn new(dims: [i16; 3], spacing: [f32; 3], values: Vec<f64>) -> Self {
        let [hx, hy, hz] = spacing;
        Self {
            dim: [3, dims[0], dims[1], dims[2], 1, 1, 1, 1],
            datatype: 4,
            big_endian: false,
            pixdim: [1.0, hx, hy, hz],
            slope: 1.0,
            intercept: 0.0,
            qform: None,
            sform: Some([
                [-hx, 0.0, 0.0, 10.0],
                [0.0, -hy, 0.0, 20.0],
                [0.0, 0.0, hz, 30.0],
            ]),
            units: 2,
            values,
        }
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut header = vec![0; 352];
        self.put(&mut header, 0, &348_i32.to_le_bytes());
        for (n, v) in self.dim.iter().enumerate() {
            self.put(&mut header, 40 + 2 * n, &v.to_le_bytes());
        }
        self.put(&mut header, 70, &self.datatype.to_le_bytes());
        for (n, v) in self.pixdim.iter().enumerate() {
            self.put(&mut header, 76 + 4 * n, &v.to_le_bytes());
        }
        for (at, v) in [(108, 352.0), (112, self.slope), (116, self.intercept)] {
            self.put(&mut header, at, &v.to_le_bytes());
        }
        header[123] = self.units;
        self.put(
            &mut header,
            252,
            &i16::from(self.qform.is_some()).to_le_bytes(),
        );
        self.put(
            &mut header,
            254,
            &i16::from(self.sform.is_some()).to_le_bytes(),
        );
        for (n, v) in self.qform.iter().flatten().enumerate() {
            self.put(&mut header, 256 + 4 * n, &v.to_le_bytes());
        }
        for (n, v) in self.sform.iter().flatten().flatten().enumerate() {
            self.put(&mut header, 280 + 4 * n, &v.to_le_bytes());
        }
        header[344..348].copy_from_slice(b"n+1\0");
        for &v in &self.values {
            header.extend(self.element(v));
        }
        header
    }

    fn put(&self, header: &mut [u8], at: usize, little: &[u8]) {
        let mut bytes = little.to_vec();
        if self.big_endian {
            bytes.reverse();
        }
        header[at..at + bytes.len()].copy_from_slice(&bytes);
    }

    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "test values are chosen to fit"
    )]
    fn element(&self, v: f64) -> Vec<u8> {
        let mut bytes = match self.datatype {
            2 => (v as u8).to_le_bytes().to_vec(),
            256 => (v as i8).to_le_bytes().to_vec(),
            4 => (v as i16).to_le_bytes().to_vec(),
            512 => (v as u16).to_le_bytes().to_vec(),
            8 => (v as i32).to_le_bytes().to_vec(),
            768 => (v as u32).to_le_bytes().to_vec(),
            16 => (v as f32).to_le_bytes().to_vec(),
            _ => v.to_le_bytes().to_vec(),
        };
        if self.big_endian {
            bytes.reverse();
        }
        bytes
    }

    pub(crate) fn write(&self, path: &Path) {
        std::fs::write(path, self.bytes()).expect("written");
    }
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).expect("in memory");
    encoder.finish().expect("in memory")
}

fn read_bytes(bytes: &[u8]) -> Result<Volume, NiftiError> {
    let dir = tempfile::tempdir().expect("temporary directory");
    let path = dir.path().join("volume.nii");
    std::fs::write(&path, bytes).expect("written");
    read(&path)
}

fn problem(bytes: &[u8]) -> String {
    let error = read_bytes(bytes).expect_err("must be refused").to_string();
    assert!(error.contains("volume.nii: "), "{error}");
    assert!(!error.contains('\n'), "{error}");
    error
}

fn small() -> Spec {
    Spec::new(
        [4, 3, 2],
        [0.5, 0.75, 2.0],
        (0..24).map(f64::from).collect(),
    )
}

#[test]
fn every_datatype_in_both_byte_orders_plain_and_gzipped() {
    for (datatype, low) in [
        (2, 0.0),
        (256, -100.0),
        (4, -1000.0),
        (512, 40_000.0),
        (8, -70_000.0),
        (768, 3e6),
        (16, -0.5),
        (64, 0.25),
    ] {
        for big_endian in [false, true] {
            let mut spec = small();
            (spec.datatype, spec.big_endian) = (datatype, big_endian);
            spec.values = (0..24).map(|n| low + f64::from(n)).collect();
            let plain = spec.bytes();
            for bytes in [gzip(&plain), plain] {
                let volume = read_bytes(&bytes).expect("readable");
                assert_eq!(volume.grid.dims, [4, 3, 2]);
                let got: Vec<f64> = volume.values.iter().map(|&v| f64::from(v)).collect();
                assert_eq!(got, spec.values, "datatype {datatype}");
            }
        }
    }
}

#[test]
fn slope_and_intercept_are_applied_unless_the_slope_is_none() {
    let third = |slope, intercept| {
        let mut spec = small();
        (spec.slope, spec.intercept) = (slope, intercept);
        read_bytes(&spec.bytes()).expect("readable").values[3]
    };
    assert!((third(2.0, -1000.0) + 994.0).abs() < 1e-6);
    assert!((third(1.0, -24.0) + 21.0).abs() < 1e-6);
    for none in [0.0, f32::NAN, f32::INFINITY] {
        assert!((third(none, 7.0) - 3.0).abs() < 1e-6);
    }
    assert!((third(2.0, f32::NAN) - 6.0).abs() < 1e-6);
}

/// LPS position of the voxel whose value is `value`, as the reader has it.
fn lps_of(volume: &Volume, value: f32) -> DVec3 {
    let at = volume
        .values
        .iter()
        .position(|v| (v - value).abs() < 1e-6)
        .expect("there");
    let [nx, ny, _] = volume.grid.dims;
    let c = volume.grid.centre(at % nx, at / nx % ny, at / (nx * ny));
    volume.lps_from_bone.point(c)
}

#[test]
fn every_voxel_keeps_its_place_in_the_patient_whatever_the_handedness() {
    // an oblique sform with spacings 0.5, 0.75, 2 and each lattice axis mirrored or not
    let (s, c) = (0.6_f64, 0.8_f64);
    for mirror in 0..8_u32 {
        let sign = |axis: u32| if mirror >> axis & 1 == 1 { -1.0 } else { 1.0 };
        let columns = [
            DVec3::new(c, s, 0.0) * 0.5 * sign(0),
            DVec3::new(-s, c, 0.0) * 0.75 * sign(1),
            DVec3::new(0.0, 0.0, 2.0) * sign(2),
            DVec3::new(10.0, 20.0, 30.0),
        ];
        let mut spec = small();
        #[expect(clippy::cast_possible_truncation, reason = "test values")]
        let row = |r: usize| columns.map(|column| column[r] as f32);
        spec.sform = Some([row(0), row(1), row(2)]);
        let volume = read_bytes(&spec.bytes()).expect("readable");
        let pose = &volume.lps_from_bone;
        assert!(pose.is_valid());
        // rotations alone are right-handed: the lattice must be so too
        let spacing = volume.grid.spacing_mm;
        assert!(spacing.distance(DVec3::new(0.5, 0.75, 2.0)) < 1e-6);
        for (i, j, k) in [(0, 0, 0), (3, 0, 0), (1, 2, 0), (3, 1, 1)] {
            let ras = columns[0] * f64::from(i)
                + columns[1] * f64::from(j)
                + columns[2] * f64::from(k)
                + columns[3];
            let lps = DVec3::new(-ras.x, -ras.y, ras.z);
            #[expect(clippy::cast_precision_loss, reason = "small")]
            let value = ((k * 3 + j) * 4 + i) as f32;
            assert!(
                lps_of(&volume, value).distance(lps) < 1e-5,
                "mirror {mirror}"
            );
        }
    }
}

#[test]
fn qform_and_plain_spacing_are_read_where_there_is_no_sform() {
    let mut spec = small();
    // a quarter turn about z: i goes along +y of RAS, j along -x
    let half = std::f32::consts::FRAC_1_SQRT_2;
    spec.sform = None;
    spec.qform = Some([0.0, 0.0, half, 1.0, 2.0, 3.0]);
    for qfac in [1.0, -1.0] {
        spec.pixdim[0] = qfac;
        let volume = read_bytes(&spec.bytes()).expect("readable");
        assert!(lps_of(&volume, 0.0).distance(DVec3::new(-1.0, -2.0, 3.0)) < 1e-5);
        let i1 = DVec3::new(-1.0, -2.5, 3.0);
        assert!(lps_of(&volume, 1.0).distance(i1) < 1e-5);
        let j1 = DVec3::new(-0.25, -2.0, 3.0);
        assert!(lps_of(&volume, 4.0).distance(j1) < 1e-5);
        let k1 = DVec3::new(-1.0, -2.0, 3.0 + 2.0 * f64::from(qfac));
        assert!(lps_of(&volume, 12.0).distance(k1) < 1e-5);
    }
    (spec.qform, spec.units) = (None, 3);
    spec.pixdim = [1.0, 500.0, 750.0, 2000.0];
    let volume = read_bytes(&spec.bytes()).expect("micrometres");
    assert!(lps_of(&volume, 5.0).distance(DVec3::new(-0.5, -0.75, 0.0)) < 1e-5);
}

#[test]
fn version_2_is_read() {
    let mut bytes = vec![0; 544];
    let mut put = |at: usize, v: &[u8]| bytes[at..at + v.len()].copy_from_slice(v);
    put(0, &540_i32.to_le_bytes());
    put(4, b"n+2\0\r\n\x1a\n");
    put(12, &16_i16.to_le_bytes());
    for (n, d) in [3_i64, 2, 2, 1].into_iter().enumerate() {
        put(16 + 8 * n, &d.to_le_bytes());
    }
    for (n, h) in [1.0_f64, 0.5, 0.75, 2.0].into_iter().enumerate() {
        put(104 + 8 * n, &h.to_le_bytes());
    }
    put(168, &544_i64.to_le_bytes());
    put(176, &3.0_f64.to_le_bytes());
    put(348, &1_i32.to_le_bytes());
    for (at, v) in [(400, 0.5), (440, 0.75), (480, 2.0), (424, -4.0_f64)] {
        put(at, &v.to_le_bytes());
    }
    put(500, &2_i32.to_le_bytes());
    for v in [1.0_f32, 2.0, 3.0, 4.0] {
        bytes.extend(v.to_le_bytes());
    }
    let volume = read_bytes(&bytes).expect("readable");
    assert!(lps_of(&volume, 12.0).distance(DVec3::new(3.5, -0.75, 0.0)) < 1e-9);
}

#[test]
fn wrong_files_are_named_with_field_and_remedy() {
    let good = small().bytes();
    assert!(problem(b"").contains("not a NIfTI"));
    assert!(problem(&[7; 4000]).contains("not a NIfTI"));
    assert!(problem(&gzip(b"a text")).contains("not a NIfTI"));
    let mut magic = good.clone();
    magic[344..348].copy_from_slice(b"nope");
    assert!(problem(&magic).contains("magic"));
    magic[344..348].copy_from_slice(b"ni1\0");
    assert!(problem(&magic).contains(".img"));
    assert!(problem(&good[..200]).contains("348 bytes of header expected, 200 there"));
    assert!(problem(&good[..390]).contains("48 bytes of voxels expected, 38 there"));
    let zipped = gzip(&Spec::new([40, 40, 40], [1.0; 3], vec![7.0; 64_000]).bytes());
    assert!(problem(&zipped[..zipped.len() / 2]).contains("128000 bytes of voxels expected"));
    let mut damaged = gzip(&good);
    damaged[30..60].fill(0xff);
    assert!(problem(&damaged).contains("gzip stream is damaged"));
    let missing = read(Path::new("/nowhere/ct.nii"))
        .expect_err("no file")
        .to_string();
    assert!(
        missing.starts_with("/nowhere/ct.nii: cannot be read"),
        "{missing}"
    );
}

#[test]
fn wrong_fields_are_named_with_their_value() {
    let with = |change: &dyn Fn(&mut Spec)| {
        let mut spec = small();
        change(&mut spec);
        problem(&spec.bytes())
    };
    for (code, name) in [
        (32, "complex"),
        (128, "RGB"),
        (1, "1-bit"),
        (999, "unknown"),
    ] {
        let text = with(&|s| s.datatype = code);
        assert!(
            text.contains(&format!("datatype = {code} ({name})")),
            "{text}"
        );
    }
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-5, 50.0] {
        assert!(with(&|s| s.pixdim[2] = bad).contains("pixdim[2]"));
    }
    let flat = with(&|s| s.sform = Some([[0.0; 4]; 3]));
    assert!(flat.contains("length of sform column 0"), "{flat}");
    assert!(with(&|s| s.sform = Some([[f32::NAN; 4]; 3])).contains("sform is not a finite"));
    for bad in [0, -3, 5000] {
        assert!(with(&|s| s.dim[3] = bad).contains(&format!("dim[3] = {bad}")));
    }
    assert!(with(&|s| s.dim[0] = 2).contains("dim[0] = 2"));
    assert!(with(&|s| s.dim = [4, 4, 3, 2, 6, 1, 1, 1]).contains("dim[4] = 6"));
    let huge = with(&|s| s.dim = [3, 4096, 4096, 4096, 1, 1, 1, 1]);
    assert!(huge.contains("2147483648 voxels"), "{huge}");
    let sheared = with(&|s| {
        s.sform = Some([
            [0.5, 0.1, 0.0, 0.0],
            [0.0, 0.75, 0.0, 0.0],
            [0.0, 0.0, 2.0, 0.0],
        ]);
    });
    assert!(sheared.contains("axes i and j are sheared"), "{sheared}");
    // a promise of 2³¹ bytes costs nothing until the bytes come
    let promised = with(&|s| s.dim = [3, 1024, 1024, 1024, 1, 1, 1, 1]);
    assert!(promised.contains("2147483648 bytes of voxels expected, 48 there"));
    let mut offset = small().bytes();
    offset[108..112].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(problem(&offset).contains("vox_offset"));
}

#[test]
fn a_fourth_axis_of_length_one_is_a_volume() {
    let mut spec = small();
    spec.dim[0] = 4;
    assert_eq!(
        read_bytes(&spec.bytes()).expect("readable").values.len(),
        24
    );
}
