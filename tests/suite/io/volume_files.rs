//! A small image, and its writer in every variant of the formats.

use flate2::Compression;
use flate2::write::{GzEncoder, ZlibEncoder};
use glam::{DAffine3, DMat3, DQuat, DVec3};
use palpate::mesh::ScalarType;
use palpate::volume::{Raw, Volume};
use std::io::Write;

pub const TYPES: [ScalarType; 10] = [
    ScalarType::I8,
    ScalarType::U8,
    ScalarType::I16,
    ScalarType::U16,
    ScalarType::I32,
    ScalarType::U32,
    ScalarType::I64,
    ScalarType::U64,
    ScalarType::F32,
    ScalarType::F64,
];

/// Storage of the voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Place {
    Attached,
    Packed,
    Beside,
    BesidePacked,
    /// As text; for NIfTI: version 2.
    Text,
    /// After skipped content; for NIfTI: positioned by the qform alone.
    Skipped,
}

pub const PLACES: [Place; 6] = [
    Place::Attached,
    Place::Packed,
    Place::Beside,
    Place::BesidePacked,
    Place::Text,
    Place::Skipped,
];

/// Content of all files.
pub struct Image {
    pub size: [usize; 3],
    pub scalar: ScalarType,
    pub values: Vec<f64>,
    turn: DQuat,
    spacing: DVec3,
    pub to_world: DAffine3,
}

/// A header file and the other files in its folder.
pub struct File {
    pub name: String,
    pub bytes: Vec<u8>,
    pub beside: Vec<(String, Vec<u8>)>,
}

impl Image {
    /// Creates an oblique, left-handed image with the extremes of its type.
    pub fn new(scalar: ScalarType) -> Image {
        let size = [3, 4, 2];
        let (low, high) = match scalar {
            ScalarType::I8 => (-128.0, 127.0),
            ScalarType::U8 => (0.0, 255.0),
            ScalarType::I16 => (-32768.0, 32767.0),
            ScalarType::U16 => (0.0, 65535.0),
            ScalarType::I32 => (-2147483648.0, 2147483647.0),
            ScalarType::U32 => (0.0, 4294967295.0),
            ScalarType::I64 => (-9007199254740992.0, 9007199254740991.0),
            ScalarType::U64 => (0.0, 9007199254740991.0),
            ScalarType::F32 => (-1.5, 16777215.0),
            ScalarType::F64 => (-1e300, 0.1),
        };
        let mut values: Vec<f64> = (1..=24).map(|n| f64::from(n % 11)).collect();
        values[5] = low;
        values[17] = high;
        let turn = DQuat::from_xyzw(0.1, -0.2, 0.3, 0.9).normalize();
        let spacing = DVec3::new(0.5, 0.75, 2.0);
        let hand = DMat3::from_diagonal(spacing * DVec3::new(1.0, 1.0, -1.0));
        let to_world = DAffine3::from_mat3_translation(
            DMat3::from_quat(turn) * hand,
            DVec3::new(10.0, -20.0, 3.25),
        );
        Image {
            size,
            scalar,
            values,
            turn,
            spacing,
            to_world,
        }
    }

    pub fn volume(&self) -> Volume {
        let v = &self.values;
        macro_rules! raw {
            ($raw:ident, $type:ty) => {
                Raw::$raw(v.iter().map(|x| *x as $type).collect())
            };
        }
        let raw = match self.scalar {
            ScalarType::I8 => raw!(I8, i8),
            ScalarType::U8 => raw!(U8, u8),
            ScalarType::I16 => raw!(I16, i16),
            ScalarType::U16 => raw!(U16, u16),
            ScalarType::I32 => raw!(I32, i32),
            ScalarType::U32 => raw!(U32, u32),
            ScalarType::I64 => raw!(I64, i64),
            ScalarType::U64 => raw!(U64, u64),
            ScalarType::F32 => raw!(F32, f32),
            ScalarType::F64 => raw!(F64, f64),
        };
        Volume {
            size: self.size,
            raw,
            to_world: self.to_world,
            ..Volume::default()
        }
    }

    pub fn bytes(&self, big: bool) -> Vec<u8> {
        let mut bytes = Vec::new();
        for v in &self.values {
            let mut number = match self.scalar {
                ScalarType::I8 => (*v as i8).to_be_bytes().to_vec(),
                ScalarType::U8 => (*v as u8).to_be_bytes().to_vec(),
                ScalarType::I16 => (*v as i16).to_be_bytes().to_vec(),
                ScalarType::U16 => (*v as u16).to_be_bytes().to_vec(),
                ScalarType::I32 => (*v as i32).to_be_bytes().to_vec(),
                ScalarType::U32 => (*v as u32).to_be_bytes().to_vec(),
                ScalarType::I64 => (*v as i64).to_be_bytes().to_vec(),
                ScalarType::U64 => (*v as u64).to_be_bytes().to_vec(),
                ScalarType::F32 => (*v as f32).to_be_bytes().to_vec(),
                ScalarType::F64 => v.to_be_bytes().to_vec(),
            };
            if !big {
                number.reverse();
            }
            bytes.extend(number);
        }
        bytes
    }

    fn text(&self) -> Vec<u8> {
        let words: Vec<String> = self.values.iter().map(f64::to_string).collect();
        words.join(" ").into_bytes()
    }
}

pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = ZlibEncoder::new(Vec::new(), Compression::default());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Converts RAS to LPS.
fn lps(v: DVec3) -> [f64; 3] {
    [-v.x, -v.y, v.z]
}

pub fn nrrd(image: &Image, big: bool, place: Place) -> File {
    let kind = match image.scalar {
        ScalarType::I8 => "signed char",
        ScalarType::U8 => "uchar",
        ScalarType::I16 => "short",
        ScalarType::U16 => "unsigned short int",
        ScalarType::I32 => "int32_t",
        ScalarType::U32 => "uint",
        ScalarType::I64 => "longlong",
        ScalarType::U64 => "uint64",
        ScalarType::F32 => "float",
        ScalarType::F64 => "double",
    };
    let [i, j, k] = image.size;
    let vector = |v| {
        let [x, y, z] = lps(v);
        format!("({x},{y}, {z})")
    };
    let axes = image.to_world.matrix3;
    let mut header = format!(
        "NRRD0005\n# a comment\ntype: {kind}\ndimension: 4\nspace: left-posterior-superior\nsizes: 1 {i} {j} {k}\nspace directions: none {} {} {}\nkinds: list domain domain domain\nspace origin: {}\n",
        vector(axes.x_axis),
        vector(axes.y_axis),
        vector(axes.z_axis),
        vector(image.to_world.translation)
    );
    header += if big {
        "endian: big\n"
    } else {
        "endian: little\n"
    };
    let bytes = image.bytes(big);
    let (lines, data) = match place {
        Place::Attached | Place::Beside => ("encoding: raw\n", bytes),
        Place::Packed | Place::BesidePacked => ("encoding: gzip\n", gzip(&bytes)),
        Place::Text => ("encoding: ascii\n", image.text()),
        Place::Skipped => (
            "encoding: raw\nline skip: 1\nbyte skip: -1\n",
            [b"junk\nmore junk".to_vec(), bytes].concat(),
        ),
    };
    header += lines;
    if matches!(place, Place::Beside | Place::BesidePacked) {
        header += "data file: voxels.bin\n";
        return File {
            name: "a.nhdr".into(),
            bytes: header.into_bytes(),
            beside: vec![("voxels.bin".into(), data)],
        };
    }
    header += "\n";
    File {
        name: "a.nrrd".into(),
        bytes: [header.into_bytes(), data].concat(),
        beside: Vec::new(),
    }
}

pub fn metaimage(image: &Image, big: bool, place: Place) -> File {
    let kind = match image.scalar {
        ScalarType::I8 => "MET_CHAR",
        ScalarType::U8 => "MET_UCHAR",
        ScalarType::I16 => "MET_SHORT",
        ScalarType::U16 => "MET_USHORT",
        ScalarType::I32 => "MET_INT",
        ScalarType::U32 => "MET_UINT",
        ScalarType::I64 => "MET_LONG_LONG",
        ScalarType::U64 => "MET_ULONG_LONG",
        ScalarType::F32 => "MET_FLOAT",
        ScalarType::F64 => "MET_DOUBLE",
    };
    let [i, j, k] = image.size;
    let axes = image.to_world.matrix3;
    let spacing = image.spacing.to_array();
    let columns = [axes.x_axis, axes.y_axis, axes.z_axis];
    let mut matrix = String::new();
    for n in 0..3 {
        for x in lps(columns[n] / spacing[n]) {
            matrix += &format!("{x} ");
        }
    }
    let [x, y, z] = lps(image.to_world.translation);
    let [a, b, c] = spacing;
    let mut header = format!(
        "ObjectType = Image\nNDims = 3\nBinaryData = {}\nBinaryDataByteOrderMSB = {}\nTransformMatrix = {matrix}\nOffset = {x} {y} {z}\nElementSpacing = {a} {b} {c}\nDimSize = {i} {j} {k}\nElementType = {kind}\n",
        place != Place::Text,
        if big { "True" } else { "False" },
    );
    let bytes = image.bytes(big);
    let data = match place {
        Place::Attached | Place::Beside => bytes,
        Place::Packed | Place::BesidePacked => {
            let packed = zlib(&bytes);
            header += &format!(
                "CompressedData = True\nCompressedDataSize = {}\n",
                packed.len()
            );
            packed
        }
        Place::Text => image.text(),
        Place::Skipped => {
            header += if big {
                "HeaderSize = -1\n"
            } else {
                "HeaderSize = 5\n"
            };
            [b"jumps".to_vec(), bytes].concat()
        }
    };
    if matches!(place, Place::Beside | Place::BesidePacked) {
        header += "ElementDataFile = voxels.raw\n";
        return File {
            name: "a.mhd".into(),
            bytes: header.into_bytes(),
            beside: vec![("voxels.raw".into(), data)],
        };
    }
    header += "ElementDataFile = LOCAL\n";
    File {
        name: "a.mha".into(),
        bytes: [header.into_bytes(), data].concat(),
        beside: Vec::new(),
    }
}

pub fn nifti(image: &Image, big: bool, place: Place) -> File {
    let second = place == Place::Text;
    let beside = matches!(place, Place::Beside | Place::BesidePacked);
    let mut header = vec![0u8; if second { 544 } else { 352 }];
    let mut put = |at: usize, number: &[u8]| {
        let mut number = number.to_vec();
        if big {
            number.reverse();
        }
        header[at..at + number.len()].copy_from_slice(&number);
    };
    // A real number and a code, in the width of the version.
    let real = |v: f64| match second {
        true => v.to_le_bytes().to_vec(),
        false => (v as f32).to_le_bytes().to_vec(),
    };
    let code = |v: i32| match second {
        true => v.to_le_bytes().to_vec(),
        false => (v as i16).to_le_bytes().to_vec(),
    };
    let width = if second { 8 } else { 4 };
    let (kind, bits): (i16, i16) = match image.scalar {
        ScalarType::U8 => (2, 8),
        ScalarType::I16 => (4, 16),
        ScalarType::I32 => (8, 32),
        ScalarType::F32 => (16, 32),
        ScalarType::F64 => (64, 64),
        ScalarType::I8 => (256, 8),
        ScalarType::U16 => (512, 16),
        ScalarType::U32 => (768, 32),
        ScalarType::I64 => (1024, 64),
        ScalarType::U64 => (1280, 64),
    };
    let dim = [4, image.size[0], image.size[1], image.size[2], 1, 1, 1, 1];
    for (n, d) in dim.into_iter().enumerate() {
        match second {
            true => put(16 + 8 * n, &(d as i64).to_le_bytes()),
            false => put(40 + 2 * n, &(d as i16).to_le_bytes()),
        }
    }
    put(0, &(if second { 540i32 } else { 348 }).to_le_bytes());
    put(if second { 12 } else { 70 }, &kind.to_le_bytes());
    put(if second { 14 } else { 72 }, &bits.to_le_bytes());
    let pixdim = if second { 104 } else { 76 };
    put(pixdim, &real(-1.0));
    for (n, s) in image.spacing.to_array().into_iter().enumerate() {
        put(pixdim + width * (n + 1), &real(s));
    }
    let by_qform = place == Place::Skipped;
    let offset = if beside {
        0
    } else if second {
        544
    } else {
        352
    };
    match second {
        true => put(168, &(offset as i64).to_le_bytes()),
        false => put(108, &(offset as f32).to_le_bytes()),
    }
    let [qform_code, sform_code, parts, rows] = match second {
        true => [344, 348, 352, 400],
        false => [252, 254, 256, 280],
    };
    put(qform_code, &code(1));
    let shift = image.to_world.translation;
    let q = image.turn;
    // A wrong qform, which the sform must override.
    let wrong = if by_qform { 0.0 } else { 1.0 };
    let quaternion = [q.x, q.y, q.z, shift.x + wrong, shift.y, shift.z];
    for (n, v) in quaternion.into_iter().enumerate() {
        put(parts + width * n, &real(v));
    }
    if !by_qform {
        put(sform_code, &code(2));
        for r in 0..3 {
            let row = image.to_world.matrix3.row(r);
            let row = [row.x, row.y, row.z, shift[r]];
            for (n, v) in row.into_iter().enumerate() {
                put(rows + width * (4 * r + n), &real(v));
            }
        }
    }
    let magic: &[u8] = match (second, beside) {
        (true, _) => b"n+2\0\r\n\x1a\n",
        (false, true) => b"ni1\0",
        (false, false) => b"n+1\0",
    };
    let at = if second { 4 } else { 344 };
    header[at..at + magic.len()].copy_from_slice(magic);
    let bytes = image.bytes(big);
    if beside {
        let (name, bytes) = match place {
            Place::BesidePacked => ("a.img.gz", gzip(&bytes)),
            _ => ("a.img", bytes),
        };
        return File {
            name: "a.hdr".into(),
            bytes: header,
            beside: vec![(name.into(), bytes)],
        };
    }
    let whole = [header, bytes].concat();
    let (name, bytes) = match place {
        Place::Packed => ("a.nii.gz", gzip(&whole)),
        _ => ("a.nii", whole),
    };
    File {
        name: name.into(),
        bytes,
        beside: Vec::new(),
    }
}
