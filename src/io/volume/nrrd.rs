//! Reader for NRRD, attached (.nrrd) and with its data in other files (.nhdr).
//!
//! The format is described at teem.sourceforge.net/nrrd/format.html.

use super::Fetch;
use super::pattern::numbered;
use super::voxels::{Packing, bytes_in, decode, decode_text, extent, unpack};
use crate::io::cursor::Parse;
use crate::mesh::ScalarType;
use crate::volume::Volume;
use glam::{DAffine3, DMat3, DVec3};
use std::collections::{BTreeMap, HashMap};

/// How the format begins.
pub(super) const MAGIC: &[u8] = b"NRRD000";

/// The fields and key/value pairs of a header.
struct Header {
    /// By name in lower case, with their line.
    fields: HashMap<String, (usize, String)>,
    pairs: Vec<(String, String)>,
}

/// The bytes of `file` as a volume.
pub(super) fn read(file: &[u8], fetch: Fetch) -> Parse<Volume> {
    let (header, data) = Header::parse(file)?;
    let scalar = scalar_type(&header)?;
    let axes = Axes::new(&header)?;
    let (voxels, bytes) = extent(axes.size, scalar)?;
    let packed = header.data(data, fetch)?;
    let raw = match header.require("encoding")?.1.to_lowercase().as_str() {
        "txt" | "text" | "ascii" => decode_text(header.skipped(&packed, None)?, scalar, voxels)?,
        "raw" => {
            let block = header.skipped(&packed, Some(bytes))?;
            decode(
                &unpack(block, Packing::Raw, bytes)?,
                scalar,
                header.big_endian(scalar)?,
            )
        }
        "gz" | "gzip" => {
            let lines = header.number("line skip")?.unwrap_or(0);
            let skip = header.byte_skip()?.unwrap_or(0);
            let block = after_lines(&packed, lines)?;
            // Bytes are skipped in the data, not in its compressed form.
            let wanted = bytes
                .checked_add(skip)
                .ok_or("`byte skip` is larger than any file")?;
            let unpacked = unpack(block, Packing::Gzip, wanted)?;
            decode(&unpacked[skip..], scalar, header.big_endian(scalar)?)
        }
        other => {
            return Err(format!(
                "the encoding \"{other}\" is not read; raw, gzip and text are (`unu save -e gzip` converts)"
            ));
        }
    };
    Ok(Volume {
        size: axes.size,
        raw,
        slope: 1.0,
        intercept: 0.0,
        to_world: axes.to_world,
        names: header.segment_names(),
    })
}

impl Header {
    /// The header, and the bytes after its empty line.
    fn parse(file: &[u8]) -> Parse<(Header, &[u8])> {
        let mut header = Header {
            fields: HashMap::new(),
            pairs: Vec::new(),
        };
        let mut rest = file;
        let mut number = 0;
        while !rest.is_empty() {
            number += 1;
            let end = rest.iter().position(|b| *b == b'\n');
            let line = &rest[..end.unwrap_or(rest.len())];
            rest = &rest[end.map_or(rest.len(), |e| e + 1)..];
            let line = String::from_utf8_lossy(line.strip_suffix(b"\r").unwrap_or(line));
            if line.is_empty() {
                return Ok((header, rest));
            }
            if number == 1 || line.starts_with('#') {
                continue;
            }
            if let Some((key, value)) = line.split_once(":=") {
                header
                    .pairs
                    .push((key.trim().to_owned(), value.trim().to_owned()));
            } else if let Some((name, value)) = line.split_once(':') {
                let name = name.trim().to_lowercase();
                let value = value.trim().to_owned();
                let list = matches!(name.as_str(), "data file" | "datafile")
                    && value.to_uppercase().starts_with("LIST");
                header.fields.insert(name, (number, value));
                if list {
                    // The names follow, to the end of the file.
                    let names = String::from_utf8_lossy(rest);
                    let names = names.lines().map(str::trim).filter(|l| !l.is_empty());
                    header
                        .pairs
                        .extend(names.map(|n| (String::new(), n.to_owned())));
                    return Ok((header, &[]));
                }
            } else {
                return Err(format!(
                    "line {number}: expected \"field: value\", found {:?}",
                    line.chars().take(40).collect::<String>()
                ));
            }
        }
        Ok((header, &[]))
    }

    fn get(&self, name: &str) -> Option<(usize, &str)> {
        let joined = name.replace(' ', "");
        let found = self.fields.get(name).or_else(|| self.fields.get(&joined));
        found.map(|(line, value)| (*line, value.as_str()))
    }

    fn require(&self, name: &str) -> Parse<(usize, &str)> {
        self.get(name)
            .ok_or_else(|| format!("the header has no field `{name}`"))
    }

    fn number(&self, name: &str) -> Parse<Option<usize>> {
        let Some((line, value)) = self.get(name) else {
            return Ok(None);
        };
        match value.parse() {
            Ok(n) => Ok(Some(n)),
            Err(_) => Err(format!(
                "line {line}: `{name}` should be a whole number from 0 on, but is \"{value}\""
            )),
        }
    }

    /// `byte skip`; none where it is -1, which means "the last bytes of the file".
    fn byte_skip(&self) -> Parse<Option<usize>> {
        match self.get("byte skip") {
            None => Ok(Some(0)),
            Some((_, "-1")) => Ok(None),
            Some(_) => self.number("byte skip"),
        }
    }

    /// The data, from this file or from those it names.
    fn data(&self, attached: &[u8], fetch: Fetch) -> Parse<Vec<u8>> {
        let Some((line, named)) = self.get("data file") else {
            if attached.is_empty() {
                return Err("the file ends after its header, where the voxels should be".into());
            }
            return Ok(attached.to_vec());
        };
        let listed: Vec<String> = self
            .pairs
            .iter()
            .filter(|(key, _)| key.is_empty())
            .map(|(_, name)| name.clone())
            .collect();
        let names = match (
            named.to_uppercase().starts_with("LIST"),
            named.contains('%'),
        ) {
            (true, _) => listed,
            (false, true) => numbered(named).ok_or_else(|| {
                format!(
                    "line {line}: `data file` should be a name, LIST, or \"NAME%03d FIRST LAST STEP\", but is \"{named}\""
                )
            })?,
            (false, false) => vec![named.to_owned()],
        };
        if names.len() > 1 && self.byte_skip()? != Some(0) {
            return Err("`byte skip` over several data files is not read; join them first".into());
        }
        let mut data = Vec::new();
        for name in &names {
            data.extend(fetch(name)?);
        }
        Ok(data)
    }

    /// `data` after the lines and bytes that are to be skipped; `wanted` bytes at the end where
    /// the header says so.
    fn skipped<'a>(&self, data: &'a [u8], wanted: Option<usize>) -> Parse<&'a [u8]> {
        let data = after_lines(data, self.number("line skip")?.unwrap_or(0))?;
        match (self.byte_skip()?, wanted) {
            (Some(skip), _) => data.get(skip..).ok_or_else(|| {
                format!(
                    "`byte skip` is {skip}, but there are only {} bytes of data",
                    data.len()
                )
            }),
            (None, Some(wanted)) => Ok(&data[data.len().saturating_sub(wanted)..]),
            (None, None) => Err("`byte skip: -1` makes sense for raw data only".into()),
        }
    }

    fn big_endian(&self, scalar: ScalarType) -> Parse<bool> {
        match self.get("endian") {
            Some((_, value)) if value.eq_ignore_ascii_case("little") => Ok(false),
            Some((_, value)) if value.eq_ignore_ascii_case("big") => Ok(true),
            None if bytes_in(scalar) == 1 => Ok(false),
            None => Err(format!(
                "numbers of {} bytes need a field `endian` (little or big), and there is none",
                bytes_in(scalar)
            )),
            Some((line, value)) => Err(format!(
                "line {line}: `endian` should be little or big, but is \"{value}\""
            )),
        }
    }

    /// The names of labels, as 3D Slicer writes them for segmentations.
    fn segment_names(&self) -> BTreeMap<i64, String> {
        let value = |key: String| {
            let found = self.pairs.iter().find(|(k, _)| *k == key);
            found.map(|(_, value)| value.clone())
        };
        self.pairs
            .iter()
            .filter_map(|(key, label)| {
                let segment = key.strip_suffix("_LabelValue")?;
                let name = value(format!("{segment}_Name"))?;
                Some((label.parse().ok()?, name))
            })
            .collect()
    }
}

fn after_lines(mut data: &[u8], lines: usize) -> Parse<&[u8]> {
    for skipped in 0..lines {
        let end = data.iter().position(|b| *b == b'\n').ok_or_else(|| {
            format!("`line skip` is {lines}, but the data has only {skipped} lines")
        })?;
        data = &data[end + 1..];
    }
    Ok(data)
}

fn scalar_type(header: &Header) -> Parse<ScalarType> {
    let (line, name) = header.require("type")?;
    Ok(match name.to_lowercase().as_str() {
        "signed char" | "int8" | "int8_t" => ScalarType::I8,
        "uchar" | "unsigned char" | "uint8" | "uint8_t" => ScalarType::U8,
        "short" | "short int" | "signed short" | "signed short int" | "int16" | "int16_t" => {
            ScalarType::I16
        }
        "ushort" | "unsigned short" | "unsigned short int" | "uint16" | "uint16_t" => {
            ScalarType::U16
        }
        "int" | "signed int" | "int32" | "int32_t" => ScalarType::I32,
        "uint" | "unsigned int" | "uint32" | "uint32_t" => ScalarType::U32,
        "longlong"
        | "long long"
        | "long long int"
        | "signed long long"
        | "signed long long int"
        | "int64"
        | "int64_t" => ScalarType::I64,
        "ulonglong" | "unsigned long long" | "unsigned long long int" | "uint64" | "uint64_t" => {
            ScalarType::U64
        }
        "float" => ScalarType::F32,
        "double" => ScalarType::F64,
        _ => {
            return Err(format!(
                "line {line}: the type \"{name}\" is not one of numbers; Palpate reads integers of 8 to 64 bits, float and double"
            ));
        }
    })
}

/// The three axes of space.
struct Axes {
    size: [usize; 3],
    to_world: DAffine3,
}

impl Axes {
    fn new(header: &Header) -> Parse<Axes> {
        let (line, sizes) = header.require("sizes")?;
        let sizes: Vec<usize> = sizes
            .split_whitespace()
            .map(|w| w.parse().ok().filter(|n| *n > 0))
            .collect::<Option<_>>()
            .ok_or_else(|| {
                format!("line {line}: `sizes` should be numbers from 1 on, but is \"{sizes}\"")
            })?;
        if let Some(dimension) = header.number("dimension")?
            && dimension != sizes.len()
        {
            return Err(format!(
                "line {line}: `dimension` is {dimension}, but `sizes` has {} numbers",
                sizes.len()
            ));
        }
        let directions = match header.get("space directions") {
            Some((line, text)) => Some(vectors(line, text, sizes.len())?),
            None => None,
        };
        // What is not an axis of space must have one value only.
        let in_space: Vec<usize> = match &directions {
            Some(directions) => (0..sizes.len())
                .filter(|a| directions[*a].is_some())
                .collect(),
            None if sizes.len() > 3 => (0..sizes.len()).filter(|a| sizes[*a] > 1).collect(),
            None => (0..sizes.len()).collect(),
        };
        let beside: usize = (0..sizes.len())
            .filter(|a| !in_space.contains(a))
            .map(|a| sizes[a])
            .product();
        let &[i, j, k] = in_space.as_slice() else {
            return Err(format!(
                "line {line}: a volume has three axes in space, but this has {} of sizes {sizes:?}",
                in_space.len()
            ));
        };
        if beside != 1 {
            return Err(format!(
                "line {line}: sizes {sizes:?} are several values a voxel; Palpate reads scalar volumes (`unu slice` takes one out)"
            ));
        }
        let axes = [i, j, k];
        let columns = match &directions {
            Some(directions) => axes.map(|a| directions[a].unwrap_or(DVec3::ZERO)),
            None => {
                let spacings = header.spacings(sizes.len())?;
                let mut unit = [DVec3::X, DVec3::Y, DVec3::Z].into_iter();
                axes.map(|a| unit.next().unwrap_or(DVec3::ZERO) * spacings[a])
            }
        };
        let origin = match header.get("space origin") {
            Some((line, text)) => vectors(line, text, 1)?[0].unwrap_or(DVec3::ZERO),
            None => DVec3::ZERO,
        };
        let to_ras = to_ras(header)?;
        let linear = to_ras * DMat3::from_cols(columns[0], columns[1], columns[2]);
        if linear.determinant() == 0.0 || !linear.is_finite() {
            return Err("the voxels have no volume: check `space directions` or `spacings`".into());
        }
        Ok(Axes {
            size: axes.map(|a| sizes[a]),
            to_world: DAffine3::from_mat3_translation(linear, to_ras * origin),
        })
    }
}

impl Header {
    /// The spacing of each axis, 1 where it is not known.
    fn spacings(&self, axes: usize) -> Parse<Vec<f64>> {
        let Some((line, text)) = self.get("spacings") else {
            return Ok(vec![1.0; axes]);
        };
        let spacings: Vec<f64> = text
            .split_whitespace()
            .map_while(|w| w.parse().ok())
            .map(|s: f64| if s.is_nan() { 1.0 } else { s })
            .collect();
        if spacings.len() != axes || spacings.iter().any(|s| !s.is_finite() || *s == 0.0) {
            return Err(format!(
                "line {line}: `spacings` should be {axes} numbers other than 0, but is \"{text}\""
            ));
        }
        Ok(spacings)
    }
}

/// `count` vectors such as `(1,0,0)`; `none` where an axis is not one of space.
fn vectors(line: usize, text: &str, count: usize) -> Parse<Vec<Option<DVec3>>> {
    let wrong = || {
        format!(
            "line {line}: {count} vectors of three numbers, such as (0.5,0,0), are expected, found \"{text}\""
        )
    };
    let mut found = Vec::new();
    let mut rest = text.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            found.push(None);
            rest = after.trim_start();
            continue;
        }
        let inner = rest.strip_prefix('(').ok_or_else(wrong)?;
        let (inner, after) = inner.split_once(')').ok_or_else(wrong)?;
        let numbers: Vec<f64> = inner
            .split(',')
            .map(|w| w.trim().parse().ok())
            .collect::<Option<_>>()
            .ok_or_else(wrong)?;
        let three: [f64; 3] = numbers.try_into().map_err(|_| wrong())?;
        found.push(Some(DVec3::from(three)).filter(|v| v.is_finite()));
        rest = after.trim_start();
    }
    match found.len() == count {
        true => Ok(found),
        false => Err(wrong()),
    }
}

/// From the header's space, in its units, to RAS in mm.
fn to_ras(header: &Header) -> Parse<DMat3> {
    let signs = match header.get("space") {
        // Nothing is said: as the numbers are.
        None => DVec3::ONE,
        Some((line, name)) => match name.to_lowercase().as_str() {
            "right-anterior-superior" | "ras" | "scanner-xyz" | "3d-right-handed" => DVec3::ONE,
            "left-anterior-superior" | "las" => DVec3::new(-1.0, 1.0, 1.0),
            "left-posterior-superior" | "lps" => DVec3::new(-1.0, -1.0, 1.0),
            "3d-left-handed" => DVec3::new(1.0, 1.0, -1.0),
            other => {
                return Err(format!(
                    "line {line}: the space \"{other}\" is not known; three-dimensional spaces without time are (left-posterior-superior, for example)"
                ));
            }
        },
    };
    let unit = match header.get("space units") {
        None => 1.0,
        Some((line, text)) => {
            let name = text.split('"').nth(1).unwrap_or(text).trim();
            match crate::mesher::metres_in(name) {
                Some(metres) => metres * 1e3,
                None if name.is_empty() || name == "???" => 1.0,
                None => {
                    return Err(format!(
                        "line {line}: `space units` should be mm, cm, m or um, but is \"{name}\""
                    ));
                }
            }
        }
    };
    Ok(DMat3::from_diagonal(signs * unit))
}
