//! Series of DICOM slices, written here with the crate used by the reader.

use dicom_core::value::{DataSetSequence, InMemFragment, PixelFragmentSequence};
use dicom_core::{DataElement, PrimitiveValue, Tag, VR};
use dicom_object::{FileMetaTableBuilder, InMemDicomObject};
use glam::DVec3;
use palpate::io;
use palpate::volume::{Raw, Volume};
use std::path::Path;

const IMPLICIT: &str = "1.2.840.10008.1.2";
const EXPLICIT: &str = "1.2.840.10008.1.2.1";
const BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";
const RUN_LENGTH: &str = "1.2.840.10008.1.2.5";

const COLUMNS: u16 = 3;
const ROWS: u16 = 2;

/// A slice of a series, oblique about the x axis, with signed pixels.
#[derive(Clone)]
struct Slice {
    name: String,
    syntax: &'static str,
    series: &'static str,
    /// Along the normal, in mm.
    at: f64,
    slope: f64,
    pixels: Vec<i16>,
}

fn slices(syntax: &'static str) -> Vec<Slice> {
    // The order of the names differs from that of the positions.
    [2, 0, 3, 1]
        .map(|n: i16| Slice {
            name: format!("{}.dcm", 9 - (n + 2) % 4),
            syntax,
            series: "1.2.3",
            at: 2.5 * f64::from(n),
            slope: 2.0,
            pixels: (0..6).map(|p| 1000 * n - 300 * p).collect(),
        })
        .to_vec()
}

/// An element of text.
fn text(tag: Tag, vr: VR, value: impl Into<String>) -> DataElement<InMemDicomObject> {
    DataElement::new(tag, vr, PrimitiveValue::from(value.into()))
}

fn whole(tag: Tag, value: u16) -> DataElement<InMemDicomObject> {
    DataElement::new(tag, VR::US, PrimitiveValue::from(value))
}

fn down() -> DVec3 {
    DVec3::new(0.0, 0.8, 0.6)
}

fn normal() -> DVec3 {
    DVec3::X.cross(down())
}

impl Slice {
    fn place(&self) -> DVec3 {
        DVec3::new(-10.0, 5.0, 20.0) + normal() * self.at
    }

    fn write(&self, folder: &Path) {
        let place = self.place();
        let mut object = InMemDicomObject::from_element_iter([
            text(Tag(8, 0x16), VR::UI, "1.2.840.10008.5.1.4.1.1.2"),
            text(Tag(8, 0x18), VR::UI, format!("1.2.3.{}", self.name.len())),
            text(Tag(0x20, 0xe), VR::UI, self.series),
            text(
                Tag(0x20, 0x32),
                VR::DS,
                format!("{}\\{}\\{}", place.x, place.y, place.z),
            ),
            text(Tag(0x20, 0x37), VR::DS, "1\\0\\0\\0\\0.8\\0.6"),
            text(Tag(0x28, 0x4), VR::CS, "MONOCHROME2"),
            text(Tag(0x28, 0x30), VR::DS, "0.75\\0.5"),
            text(Tag(0x28, 0x1052), VR::DS, "-7"),
            text(Tag(0x28, 0x1053), VR::DS, self.slope.to_string()),
            whole(Tag(0x28, 0x2), 1),
            whole(Tag(0x28, 0x10), ROWS),
            whole(Tag(0x28, 0x11), COLUMNS),
            whole(Tag(0x28, 0x100), 16),
            whole(Tag(0x28, 0x101), 16),
            whole(Tag(0x28, 0x102), 15),
            whole(Tag(0x28, 0x103), 1),
        ]);
        let pixels = Tag(0x7fe0, 0x10);
        if self.syntax == RUN_LENGTH {
            let fragment: InMemFragment = run_lengths(&self.pixels);
            object.put(DataElement::new(
                pixels,
                VR::OB,
                PixelFragmentSequence::new_fragments(vec![fragment]),
            ));
        } else {
            let words: Vec<u16> = self.pixels.iter().map(|p| *p as u16).collect();
            object.put(DataElement::new(
                pixels,
                VR::OW,
                PrimitiveValue::U16(words.into()),
            ));
        }
        let meta = FileMetaTableBuilder::new().transfer_syntax(self.syntax);
        let file = object.with_meta(meta).unwrap();
        file.write_to_file(folder.join(&self.name)).unwrap();
    }
}

/// Encodes high bytes as literals, low bytes as literals: a frame of two segments.
fn run_lengths(pixels: &[i16]) -> Vec<u8> {
    let mut frame = vec![0u8; 64];
    frame[0] = 2;
    for plane in 0..2 {
        let start = frame.len() as u32;
        frame[4 + 4 * plane..8 + 4 * plane].copy_from_slice(&start.to_le_bytes());
        // One pixel as a run of one, the rest as literals.
        let bytes: Vec<u8> = pixels.iter().map(|p| p.to_be_bytes()[plane]).collect();
        frame.extend([128, 0, bytes[0], bytes.len() as u8 - 2]);
        frame.extend(&bytes[1..]);
        frame.resize(frame.len().next_multiple_of(2), 0);
    }
    frame
}

fn read(slices: &[Slice]) -> palpate::Result<Volume> {
    let folder = tempfile::tempdir().unwrap();
    for slice in slices {
        slice.write(folder.path());
    }
    std::fs::write(folder.path().join("README"), "\n").unwrap();
    io::read_volume(folder.path())
}

#[test]
fn dicom_series_stacks_in_ras_for_any_encoding_and_order() {
    for syntax in [IMPLICIT, EXPLICIT, BIG_ENDIAN, RUN_LENGTH] {
        let slices = slices(syntax);
        let volume = read(&slices).unwrap_or_else(|e| panic!("{syntax}: {e}"));
        assert_eq!(volume.size, [3, 2, 4]);
        assert!(matches!(volume.raw, Raw::I16(_)));
        for slice in &slices {
            let k = (slice.at / 2.5).round() as usize;
            for n in 0..6 {
                let (i, j) = (n % 3, n / 3);
                let expected = 2.0 * f64::from(slice.pixels[n]) - 7.0;
                assert_eq!(volume.value(n + 6 * k), expected, "{syntax} {n} {k}");
                let lps = slice.place() + DVec3::X * 0.5 * i as f64 + down() * 0.75 * j as f64;
                let ras = DVec3::new(-lps.x, -lps.y, lps.z);
                assert!(volume.centre(i, j, k).abs_diff_eq(ras, 1e-9), "{syntax}");
            }
        }
    }
}

#[test]
fn slices_with_different_rescaling_keep_physical_values() {
    let mut slices = slices(EXPLICIT);
    slices[0].slope = 0.5;
    let volume = read(&slices).unwrap();
    let expected = 0.5 * f64::from(slices[0].pixels[1]) - 7.0;
    assert_eq!(volume.value(6 * 2 + 1), expected);
    assert_eq!((volume.slope, volume.intercept), (1.0, 0.0));
}

#[test]
fn reads_largest_dicom_series() {
    let mut slices = slices(EXPLICIT);
    let mut other = slices[0].clone();
    other.name = "0.dcm".into();
    other.series = "1.1";
    other.at = 77.0;
    slices.push(other);
    assert_eq!(read(&slices).unwrap().size, [3, 2, 4]);
}

#[test]
fn series_with_gaps_or_duplicates_error_names_file() {
    let whole = slices(EXPLICIT);
    let error = |slices: &[Slice]| read(slices).unwrap_err().to_string();
    let mut far = whole.clone();
    far.push(Slice {
        name: "far.dcm".into(),
        at: 15.0,
        ..whole[0].clone()
    });
    let missing = error(&far);
    assert!(missing.contains("2 slices are missing"), "{missing}");
    assert!(missing.contains("far.dcm"), "{missing}");
    let mut uneven = whole.clone();
    uneven[0].at += 0.3;
    assert!(error(&uneven).contains("evenly spaced"));
    let mut double = whole.clone();
    double.push(Slice {
        name: "twin.dcm".into(),
        ..whole[0].clone()
    });
    assert!(error(&double).contains("not one volume"));
    let alone = error(&whole[..1]);
    assert!(alone.contains("`SliceThickness`"), "{alone}");
    assert!(error(&[]).contains("DICOM image"));
}

#[test]
fn damaged_slices_are_rejected_without_panic() {
    let folder = tempfile::tempdir().unwrap();
    let slices = slices(EXPLICIT);
    for slice in &slices {
        slice.write(folder.path());
    }
    let path = folder.path().join(&slices[0].name);
    let whole = std::fs::read(&path).unwrap();
    for cut in 140..whole.len() {
        std::fs::write(&path, &whole[..cut]).unwrap();
        // Without its pixels a file is not an image, so its slice is missing.
        assert!(io::read_volume(folder.path()).is_err(), "cut at {cut}");
    }
    for at in 132..whole.len() {
        for byte in [0, 0x7f, 0xff] {
            let mut bytes = whole.clone();
            bytes[at] = byte;
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(volume) = io::read_volume(folder.path()) {
                assert_eq!(volume.raw.len(), volume.voxels());
            }
        }
    }
}

/// Writes an image of `frames` axial frames with the elements `more` to a file, and reads it.
fn read_frames(
    frames: u16,
    more: impl IntoIterator<Item = DataElement<InMemDicomObject>>,
    number: Option<usize>,
) -> palpate::Result<Volume> {
    let mut object = InMemDicomObject::from_element_iter([
        text(Tag(8, 0x16), VR::UI, "1.2.840.10008.5.1.4.1.1.2"),
        text(Tag(8, 0x18), VR::UI, "1.2.3.4"),
        text(Tag(0x20, 0xe), VR::UI, "1.2.3"),
        text(Tag(0x28, 0x4), VR::CS, "MONOCHROME2"),
        text(Tag(0x28, 0x8), VR::IS, frames.to_string()),
        whole(Tag(0x28, 0x2), 1),
        whole(Tag(0x28, 0x10), ROWS),
        whole(Tag(0x28, 0x11), COLUMNS),
        whole(Tag(0x28, 0x100), 16),
        whole(Tag(0x28, 0x101), 16),
        whole(Tag(0x28, 0x102), 15),
        whole(Tag(0x28, 0x103), 0),
    ]);
    let pixels: Vec<u16> = (0..6 * frames).collect();
    let pixels = PrimitiveValue::U16(pixels.into());
    object.put(DataElement::new(Tag(0x7fe0, 0x10), VR::OW, pixels));
    for element in more {
        object.put(element);
    }
    let meta = FileMetaTableBuilder::new().transfer_syntax(EXPLICIT);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.dcm");
    let file = object.with_meta(meta).unwrap();
    file.write_to_file(&path).unwrap();
    assert_eq!(io::detect_kind(&path).unwrap(), io::Kind::Volume);
    io::read_volume_number(path, number)
}

/// Position, orientation and spacing of axial frames.
fn axial() -> [DataElement<InMemDicomObject>; 3] {
    [
        text(Tag(0x20, 0x32), VR::DS, "10\\20\\30"),
        text(Tag(0x20, 0x37), VR::DS, "1\\0\\0\\0\\1\\0"),
        text(Tag(0x28, 0x30), VR::DS, "0.75\\0.5"),
    ]
}

fn sequence(
    tag: Tag,
    items: impl IntoIterator<Item = Vec<DataElement<InMemDicomObject>>>,
) -> DataElement<InMemDicomObject> {
    let items = items.into_iter().map(InMemDicomObject::from_element_iter);
    let items: Vec<InMemDicomObject> = items.collect();
    DataElement::new(tag, VR::SQ, DataSetSequence::from(items))
}

#[test]
fn dicom_file_reads_alone() {
    let thick = text(Tag(0x18, 0x50), VR::DS, "2.5");
    let volume = read_frames(1, axial().into_iter().chain([thick]), None).unwrap();
    assert_eq!(volume.size, [3, 2, 1]);
    assert_eq!(volume.spacing(), DVec3::new(0.5, 0.75, 2.5));
    assert!(
        volume
            .centre(0, 0, 0)
            .abs_diff_eq(DVec3::new(-10.0, -20.0, 30.0), 1e-9)
    );
    assert!(volume.notes[0].contains("one slice"), "{:?}", volume.notes);
}

#[test]
fn frames_without_positions_are_spaced_as_the_header_states() {
    let offsets = |text_: &str| text(Tag(0x3004, 0xc), VR::DS, text_);
    for (more, step) in [
        (text(Tag(0x18, 0x88), VR::DS, "4"), 4.0),
        (text(Tag(0x18, 0x50), VR::DS, "2"), 2.0),
        (offsets("0\\3\\6\\9"), 3.0),
        (offsets("0\\-3\\-6\\-9"), -3.0),
        (offsets("30\\33\\36\\39"), 3.0),
    ] {
        let volume = read_frames(4, axial().into_iter().chain([more]), None).unwrap();
        assert_eq!(volume.size, [3, 2, 4]);
        // Frames are sorted along the normal.
        let [first, last] = if step > 0.0 { [0, 3] } else { [3, 0] };
        assert_eq!(volume.value(6 * first), 0.0);
        assert_eq!(volume.value(6 * last), 18.0);
        let at = volume.centre(0, 0, last).z;
        assert!((at - 30.0 - 3.0 * step).abs() < 1e-9, "{at}");
        assert!(volume.notes[0].contains("apart"), "{:?}", volume.notes);
    }
    let error = read_frames(4, axial(), None).unwrap_err().to_string();
    assert!(error.contains("`SpacingBetweenSlices`"), "{error}");
    let dose = [offsets("0\\3"), text(Tag(0x3004, 0xe), VR::DS, "0.01")];
    let dose = read_frames(2, axial().into_iter().chain(dose), None).unwrap();
    assert!((dose.value(7) - 0.07).abs() < 1e-9);
}

#[test]
fn functional_groups_place_and_scale_frames() {
    // Two times at each of two positions; what all frames share is stated once.
    let placed = |z: &str, slope: &str| {
        vec![
            sequence(
                Tag(0x20, 0x9113),
                [vec![text(Tag(0x20, 0x32), VR::DS, format!("1\\2\\{z}"))]],
            ),
            sequence(
                Tag(0x28, 0x9145),
                [vec![
                    text(Tag(0x28, 0x1052), VR::DS, "-1"),
                    text(Tag(0x28, 0x1053), VR::DS, slope),
                ]],
            ),
        ]
    };
    let shared = vec![
        sequence(
            Tag(0x20, 0x9116),
            [vec![text(Tag(0x20, 0x37), VR::DS, "1\\0\\0\\0\\1\\0")]],
        ),
        sequence(
            Tag(0x28, 0x9110),
            [vec![
                text(Tag(0x18, 0x50), VR::DS, "9"),
                text(Tag(0x28, 0x30), VR::DS, "0.75\\0.5"),
            ]],
        ),
    ];
    let groups = |places: [&str; 4]| {
        let frames = places.map(|z| placed(z, "2"));
        [
            sequence(Tag(0x5200, 0x9229), [shared.clone()]),
            sequence(Tag(0x5200, 0x9230), frames),
        ]
    };
    let places = ["12", "7", "12", "7"];
    for (number, first) in [(0, 6.0), (1, 18.0)] {
        let volume = read_frames(4, groups(places), Some(number)).unwrap();
        assert_eq!(volume.size, [3, 2, 2]);
        assert_eq!(volume.spacing().z, 5.0);
        assert_eq!(volume.value(0), 2.0 * first - 1.0);
        assert!(
            volume
                .centre(0, 0, 0)
                .abs_diff_eq(DVec3::new(-1.0, -2.0, 7.0), 1e-9)
        );
    }
    let error = read_frames(4, groups(places), None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("2 volumes"), "{error}");
    let volume = read_frames(4, groups(["1", "2", "3", "4"]), None).unwrap();
    assert_eq!(volume.size, [3, 2, 4]);
    let error = read_frames(4, groups(["1", "2", "3", "9"]), None).unwrap_err();
    assert!(error.to_string().contains("frame 4"), "{error}");
}
