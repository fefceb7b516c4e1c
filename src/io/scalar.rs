//! Number types: names in files, and encoding.

use crate::mesh::ScalarType;

/// Returns the size of a number in bytes.
pub(super) fn size(scalar: ScalarType) -> usize {
    match scalar {
        ScalarType::I8 | ScalarType::U8 => 1,
        ScalarType::I16 | ScalarType::U16 => 2,
        ScalarType::I32 | ScalarType::U32 | ScalarType::F32 => 4,
        ScalarType::I64 | ScalarType::U64 | ScalarType::F64 => 8,
    }
}

/// Decodes every complete number of `bytes`, converted to f64.
pub(super) fn decode(bytes: &[u8], scalar: ScalarType, big_endian: bool) -> Vec<f64> {
    macro_rules! numbers {
        ($t:ty) => {
            bytes
                .as_chunks()
                .0
                .iter()
                .map(|b| {
                    if big_endian {
                        <$t>::from_be_bytes(*b) as f64
                    } else {
                        <$t>::from_le_bytes(*b) as f64
                    }
                })
                .collect()
        };
    }
    match scalar {
        ScalarType::I8 => numbers!(i8),
        ScalarType::U8 => numbers!(u8),
        ScalarType::I16 => numbers!(i16),
        ScalarType::U16 => numbers!(u16),
        ScalarType::I32 => numbers!(i32),
        ScalarType::U32 => numbers!(u32),
        ScalarType::I64 => numbers!(i64),
        ScalarType::U64 => numbers!(u64),
        ScalarType::F32 => numbers!(f32),
        ScalarType::F64 => numbers!(f64),
    }
}

/// Encodes `values` as little-endian numbers of type `scalar`.
pub(super) fn encode(values: &[f64], scalar: ScalarType) -> Vec<u8> {
    macro_rules! bytes {
        ($t:ty) => {
            values
                .iter()
                .flat_map(|x| (*x as $t).to_le_bytes())
                .collect()
        };
    }
    match scalar {
        ScalarType::I8 => bytes!(i8),
        ScalarType::U8 => bytes!(u8),
        ScalarType::I16 => bytes!(i16),
        ScalarType::U16 => bytes!(u16),
        ScalarType::I32 => bytes!(i32),
        ScalarType::U32 => bytes!(u32),
        ScalarType::I64 => bytes!(i64),
        ScalarType::U64 => bytes!(u64),
        ScalarType::F32 => bytes!(f32),
        ScalarType::F64 => bytes!(f64),
    }
}

/// Whether all `values` are preserved when written as `scalar` and read back.
pub(super) fn is_lossless(values: &[f64], scalar: ScalarType) -> bool {
    macro_rules! exact {
        ($t:ty) => {
            values
                .iter()
                .all(|x| ((*x as $t) as f64).to_bits() == x.to_bits())
        };
    }
    match scalar {
        ScalarType::I8 => exact!(i8),
        ScalarType::U8 => exact!(u8),
        ScalarType::I16 => exact!(i16),
        ScalarType::U16 => exact!(u16),
        ScalarType::I32 => exact!(i32),
        ScalarType::U32 => exact!(u32),
        ScalarType::I64 => exact!(i64),
        ScalarType::U64 => exact!(u64),
        ScalarType::F32 => values
            .iter()
            .all(|x| x.is_nan() || f64::from(*x as f32) == *x),
        ScalarType::F64 => true,
    }
}

/// Returns the VTK XML name of a number type.
pub(super) fn vtk_xml_name(scalar: ScalarType) -> &'static str {
    match scalar {
        ScalarType::I8 => "Int8",
        ScalarType::U8 => "UInt8",
        ScalarType::I16 => "Int16",
        ScalarType::U16 => "UInt16",
        ScalarType::I32 => "Int32",
        ScalarType::U32 => "UInt32",
        ScalarType::I64 => "Int64",
        ScalarType::U64 => "UInt64",
        ScalarType::F32 => "Float32",
        ScalarType::F64 => "Float64",
    }
}

/// Returns the number type of a VTK XML name.
pub(super) fn from_vtk_xml_name(name: &str) -> Option<ScalarType> {
    const ALL: [ScalarType; 10] = [
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
    ALL.into_iter().find(|s| vtk_xml_name(*s) == name)
}
