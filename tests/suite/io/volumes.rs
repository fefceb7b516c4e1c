//! Volumes: real files against SimpleITK and nibabel, every variant of the formats against one
//! image, and damage.

use crate::io::volume_files::{Image, PLACES, TYPES, gzip, metaimage, nifti, nrrd};
use glam::{DAffine3, DMat3, DVec3};
use palpate::io;
use palpate::mesh::{ScalarType, TetMesh};
use palpate::volume::{Raw, Volume, VolumeDescription};
use proptest::prelude::*;

fn real(name: &str) -> Option<Volume> {
    let path = crate::support::real_data(&format!("volumes/{name}"))?;
    Some(io::read_volume(path).unwrap())
}

/// A voxel, its position in RAS, and its value.
type Known = ([usize; 3], [f64; 3], f64);

fn holds(volume: &Volume, known: &[Known]) {
    for ([i, j, k], place, value) in known {
        let centre = volume.centre(*i, *j, *k);
        let off = centre.distance(DVec3::from(*place));
        assert!(off < 1e-6, "({i}, {j}, {k}) lies at {centre}, {off} mm off");
        let found = volume.value(i + volume.size[0] * (j + volume.size[1] * k));
        assert!((found - value).abs() < 1e-4, "{found} is not {value}");
    }
}

fn sum(volume: &Volume) -> f64 {
    (0..volume.voxels()).map(|n| volume.value(n)).sum()
}

#[test]
fn knee_volume_matches_reference_reader() {
    let Some(knee) = real("knee_labels_dess_384x384x160.nrrd") else {
        return;
    };
    assert_eq!(knee.size, [384, 384, 160]);
    let known: [Known; 3] = [
        ([0, 0, 0], [6.6536341, 77.413532, 70.0], 0.0),
        (
            [40, 50, 60],
            [49.76483132848963, 66.54623441444498, 51.7708335],
            0.0,
        ),
        (
            [383, 3, 7],
            [23.70501809910267, -61.26346513062038, 68.90625001],
            0.0,
        ),
    ];
    holds(&knee, &known);
    assert_eq!(sum(&knee), 16_834_798.0);
    let counts = [
        20_487_264, 127_311, 20_605, 19_862, 12_658, 1_532_154, 1_089_712, 143_548, 111_661,
        22_957, 25_228,
    ];
    let labels = knee.labels().unwrap();
    assert!(labels.into_iter().eq((0..).zip(counts)));
}

#[test]
fn head_volumes_match_reference_reader() {
    let Some(ct) = real("headsq_ct_64x64x93.mhd") else {
        return;
    };
    assert_eq!(ct.size, [64, 64, 93]);
    let known: [Known; 4] = [
        ([40, 50, 60], [-128.0, -160.0, 90.0], 95.0),
        ([63, 3, 7], [-201.6, -9.6, 10.5], 0.0),
        ([32, 32, 40], [-102.4, -102.4, 60.0], 122.0),
        ([20, 30, 50], [-64.0, -96.0, 75.0], 1102.0),
    ];
    holds(&ct, &known);
    assert_eq!(sum(&ct), 193_392_317.0);
    assert_eq!(ct.range(), Some((0.0, 3926.0)));

    let Some(mri) = real("head_mri_seg3d_160x232x160.nii.gz") else {
        return;
    };
    assert_eq!(mri.size, [160, 232, 160]);
    let known: [Known; 2] = [
        (
            [40, 50, 60],
            [-348.260009765625, -36.198105812072754, 459.3272113800049],
            265.03530979156494,
        ),
        (
            [159, 3, 7],
            [-229.260009765625, -78.42464590072632, 411.71004915237427],
            0.0,
        ),
    ];
    holds(&mri, &known);
    assert!((sum(&mri) - 664_081_571.759).abs() < 1.0);
    assert!((mri.range().unwrap().1 - 512.00003).abs() < 1e-4);
}

/// Reads `bytes` as the file `name`, with the files `beside` in its folder.
fn read(name: &str, bytes: &[u8], beside: &[(&str, &[u8])]) -> palpate::Result<Volume> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in beside {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    std::fs::write(folder.path().join(name), bytes).unwrap();
    io::read_volume(folder.path().join(name))
}

fn same(volume: &Volume, image: &Image, what: &str) {
    assert_eq!(volume.size, image.size, "{what}");
    assert_eq!(volume.raw.scalar_type(), image.scalar, "{what}");
    for (n, value) in image.values.iter().enumerate() {
        assert_eq!(volume.raw.get(n), *value, "{what}: voxel {n}");
    }
    assert!(
        volume.to_world.abs_diff_eq(image.to_world, 1e-5),
        "{what}: {} is not {}",
        volume.to_world,
        image.to_world
    );
}

#[test]
fn all_types_byte_orders_and_data_locations_read_identically() {
    for scalar in TYPES {
        let image = Image::new(scalar);
        for big in [false, true] {
            for place in PLACES {
                for file in [
                    nrrd(&image, big, place),
                    metaimage(&image, big, place),
                    nifti(&image, big, place),
                ] {
                    let what = format!("{} {scalar:?}, big-endian {big}, {place:?}", file.name);
                    let beside: Vec<(&str, &[u8])> = file
                        .beside
                        .iter()
                        .map(|(name, bytes)| (name.as_str(), bytes.as_slice()))
                        .collect();
                    let volume = read(&file.name, &file.bytes, &beside);
                    same(
                        &volume.unwrap_or_else(|e| panic!("{what}: {e}")),
                        &image,
                        &what,
                    );
                    // Without the detached data there is nothing to read.
                    if !beside.is_empty() {
                        let error = read(&file.name, &file.bytes, &[]).unwrap_err().to_string();
                        assert!(error.contains(&file.beside[0].0), "{what}: {error}");
                    }
                }
            }
        }
    }
}

#[test]
fn volume_formats_round_trip() {
    let folder = tempfile::tempdir().unwrap();
    for scalar in TYPES {
        let image = Image::new(scalar);
        let mut volume = image.volume();
        for name in ["a.nrrd", "a.mha", "a.nii.gz"] {
            volume.slope = if name == "a.nrrd" { 1.0 } else { 0.5 };
            volume.intercept = if name == "a.nrrd" { 0.0 } else { -3.0 };
            if name == "a.nrrd" {
                volume.label_names = [(1, "femur".into()), (7, "a: b".into())].into();
            }
            let path = folder.path().join(name);
            io::write_volume(&path, &volume).unwrap();
            let back = io::read_volume(&path).unwrap();
            same(&back, &image, name);
            assert_eq!(
                (back.slope, back.intercept),
                (volume.slope, volume.intercept)
            );
            if name == "a.nrrd" {
                assert_eq!(back.label_names, volume.label_names);
            }
        }
    }
    assert!(
        io::write_volume(
            folder.path().join("a.tif"),
            &Image::new(ScalarType::U8).volume()
        )
        .is_err()
    );
}

/// Reads a header followed by 64 bytes with each of `changes`: from, to, expected message. The
/// unchanged header is valid.
fn lies(name: &str, header: &str, changes: &[(&str, &str, &str)]) {
    let data: Vec<u8> = (1..=64).collect();
    let with = |header: &str| read(name, &[header.as_bytes(), &data].concat(), &[]);
    with(header).unwrap();
    for (from, to, what) in changes {
        let changed = header.replace(from, to);
        assert_ne!(changed, header);
        let error = with(&changed).unwrap_err().to_string();
        assert!(error.contains(name), "{error} does not name the file");
        assert!(
            error.contains(what),
            "{changed}\nsays: {error}\nnot: {what}"
        );
    }
}

#[test]
fn invalid_nrrd_header_error_names_field() {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nspace: RAS\nsizes: 4 4 4\nspace directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: raw\n\n";
    let change = [
        ("4 4 4", "4 4 5", "specifies 80 bytes"),
        ("4 4 4", "4 4 2", "specifies 32 bytes"),
        ("4 4 4", "4 4 0", "`sizes`"),
        ("4 4 4", "4 -4 4", "`sizes`"),
        ("4 4 4", "4 4", "`dimension` is 3"),
        (
            "4 4 4",
            "4000000000 4000000000 4000000000",
            "volume size must be",
        ),
        (
            "4 4 4",
            "2000000 1000000 1",
            "specifies 2000000000000 bytes",
        ),
        ("dimension: 3", "dimension: x", "`dimension`"),
        ("uint8", "block", "\"block\""),
        (
            "uint8\ndimension: 3\nspace: RAS\nsizes: 4 4 4",
            "int16\ndimension: 3\nspace: RAS\nsizes: 4 4 2",
            "`endian`",
        ),
        ("type: uint8\n", "", "`type`"),
        ("sizes: 4 4 4\n", "", "`sizes`"),
        ("encoding: raw\n", "", "`encoding`"),
        ("raw", "hex", "encoding \"hex\""),
        ("raw", "gzip", "cannot decompress"),
        ("raw", "ascii", "voxel"),
        ("RAS", "XYZ", "space \"xyz\""),
        ("(0,0,1)", "(0,0,0)", "`space directions`"),
        ("(0,0,1)", "(0,1,0)", "`space directions`"),
        ("(0,0,1)", "(0,0,1", "vectors"),
        ("(0,0,1)", "none", "2"),
        (
            "encoding: raw\n",
            "encoding: raw\nbyte skip: 100\n",
            "`byte skip`",
        ),
        (
            "encoding: raw\n",
            "encoding: raw\nline skip: 100\n",
            "`line skip`",
        ),
        (
            "encoding: raw\n",
            "encoding: raw\ndata file: gone.raw\n",
            "gone.raw",
        ),
        (
            "encoding: raw\n",
            "encoding: raw\ndata file: a%d.raw 1 9999999 1\n",
            "`data file`",
        ),
        (
            "encoding: raw\n",
            "encoding: raw\nspace units: \"furlong\"\n",
            "furlong",
        ),
        ("NRRD0004", "NARD0004", "NRRD0001"),
    ];
    lies("a.nrrd", header, &change);
}

#[test]
fn invalid_metaimage_header_error_names_field() {
    let header = "ObjectType = Image\nNDims = 3\nDimSize = 4 4 4\nElementSpacing = 1 1 1\nTransformMatrix = 1 0 0 0 1 0 0 0 1\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    let before = |line: &str| format!("{line}\nElementDataFile = LOCAL\n");
    let [channels, packed, packed_size, skip, msb] = [
        "ElementNumberOfChannels = 3",
        "CompressedData = True",
        "CompressedDataSize = 1000",
        "HeaderSize = 1000",
        "BinaryDataByteOrderMSB = Maybe",
    ]
    .map(before);
    let last = "ElementDataFile = LOCAL\n";
    let change = [
        ("4 4 4", "4 4 5", "specifies 80 bytes"),
        ("4 4 4", "4 4 2", "specifies 32 bytes"),
        ("4 4 4", "4 4 1e14", "specifies 1600000000000000 bytes"),
        ("4 4 4", "4 4 -1", "`DimSize`"),
        ("4 4 4", "4 4", "`NDims` is 3"),
        ("NDims = 3", "NDims = 1000000000", "`NDims`"),
        ("DimSize = 4 4 4\n", "", "`DimSize`"),
        ("MET_UCHAR", "MET_SHORT", "specifies 128 bytes"),
        ("MET_UCHAR", "MET_STRING", "MET_STRING"),
        (
            "ElementSpacing = 1 1 1",
            "ElementSpacing = 1 0 1",
            "`ElementSpacing`",
        ),
        (
            "ElementSpacing = 1 1 1",
            "ElementSpacing = 1 nan 1",
            "`ElementSpacing`",
        ),
        (
            "1 0 0 0 1 0 0 0 1",
            "1 0 0 1 0 0 0 0 1",
            "`TransformMatrix`",
        ),
        ("1 0 0 0 1 0 0 0 1", "1 0 0 0 1 0", "`TransformMatrix`"),
        ("LOCAL", "gone.raw", "gone.raw"),
        ("LOCAL", "", "`ElementDataFile`"),
        (last, "", "`ElementDataFile`"),
        (last, &channels, "`ElementNumberOfChannels`"),
        (last, &packed, "cannot decompress"),
        (last, &packed_size, "`CompressedDataSize`"),
        (last, &skip, "`HeaderSize`"),
        (last, &msb, "`BinaryDataByteOrderMSB`"),
    ];
    lies("a.mha", header, &change[..15]);
    for one in &change[16..] {
        lies("a.mha", header, &[*one]);
    }
}

#[test]
fn invalid_nifti_header_error_names_field() {
    use crate::io::volume_files::Place;
    let file = nifti(&Image::new(ScalarType::I16), false, Place::Attached);
    assert!(read("a.nii", &file.bytes, &[]).is_ok());
    let changes: [(usize, &[u8], &str); 15] = [
        (40, &[9, 0], "`dim[0]`"),
        (40, &[2, 0], "three axes"),
        (42, &[0, 0], "`dim`"),
        (42, &[0xff, 0xff], "`dim`"),
        (42, &[0xff, 0x7f], "specifies"),
        (48, &[2, 0], "not a single volume"),
        (46, &[1, 0], "specifies"),
        (70, &[0x80, 0], "`datatype` 128"),
        (70, &[2, 0], "`bitpix`"),
        (72, &[8, 0], "`bitpix`"),
        (108, &0f32.to_le_bytes(), ""),
        (108, &f32::NAN.to_le_bytes(), "`vox_offset`"),
        (108, &1e11f32.to_le_bytes(), "specifies"),
        (108, &100f32.to_le_bytes(), "`vox_offset`"),
        (280, &f32::NAN.to_le_bytes(), "sform"),
    ];
    for (at, bytes, what) in changes {
        let mut changed = file.bytes.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        match read("a.nii", &changed, &[]) {
            // Some writers leave the offset at 0.
            Ok(_) => assert!(what.is_empty(), "byte {at}: no error for invalid {what}"),
            Err(error) => {
                let error = error.to_string();
                assert!(
                    !what.is_empty() && error.contains(what),
                    "byte {at}: {error}"
                );
            }
        }
    }
    let error = read("a.nii", b"This is no header.", &[]).unwrap_err();
    assert!(error.to_string().contains("NIfTI header"), "{error}");
}

#[test]
fn slope_and_intercept_apply_unless_slope_is_zero() {
    use crate::io::volume_files::Place;
    let image = Image::new(ScalarType::I16);
    let mut file = nifti(&image, false, Place::Attached).bytes;
    file[116..120].copy_from_slice(&5f32.to_le_bytes());
    let plain = read("a.nii", &file, &[]).unwrap();
    file[112..116].copy_from_slice(&2f32.to_le_bytes());
    let scaled = read("a.nii", &file, &[]).unwrap();
    for (n, value) in image.values.iter().enumerate() {
        assert_eq!(plain.value(n), *value);
        assert_eq!(scaled.value(n), 2.0 * value + 5.0);
    }
}

#[test]
fn units_are_converted_to_millimetres() {
    use crate::io::volume_files::Place;
    let mut file = nifti(&Image::new(ScalarType::U8), false, Place::Attached).bytes;
    for (code, factor) in [(0u8, 1.0), (1, 1e3), (2, 1.0), (3, 1e-3)] {
        file[123] = code;
        let spacing = read("a.nii", &file, &[]).unwrap().spacing();
        assert!((spacing / factor).abs_diff_eq(DVec3::new(0.5, 0.75, 2.0), 1e-5));
    }
}

#[test]
fn nrrd_without_space_uses_spacings_and_axis_mins() {
    let header = "NRRD0001\ntype: uchar\ndimension: 3\nsizes: 1 2 2\nspacings: 2 3 4\naxis mins: 10 nan -8\ncenters: cell node node\nunits: \"um\" \"um\" \"um\"\nencoding: raw\n\n1234";
    let volume = read("a.nrrd", header.as_bytes(), &[]).unwrap();
    let scale = DMat3::from_diagonal(DVec3::new(2e-3, 3e-3, 4e-3));
    let expected = DAffine3::from_mat3_translation(scale, DVec3::new(11e-3, 0.0, -8e-3));
    assert!(
        volume.to_world.abs_diff_eq(expected, 1e-12),
        "{}",
        volume.to_world
    );
}

#[test]
fn data_file_lists_and_patterns_are_concatenated() {
    let beside: [(&str, &[u8]); 2] = [("s01.raw", b"\x20\x0a"), ("s02.raw", b"\xef\xbb")];
    let nrrd = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 1 2 2\nencoding: raw\ndata file: ";
    let meta = "ObjectType = Image\nNDims = 3\nDimSize = 1 2 2\nElementType = MET_UCHAR\nElementDataFile = ";
    for (name, header) in [("a.nhdr", nrrd), ("a.mhd", meta)] {
        for files in ["s%02d.raw 1 2 1\n", "LIST\ns01.raw\ns02.raw\n"] {
            let volume = read(name, format!("{header}{files}").as_bytes(), &beside).unwrap();
            let values: Vec<f64> = (0..4).map(|n| volume.value(n)).collect();
            assert_eq!(values, [32.0, 10.0, 239.0, 187.0], "{name} {files}");
        }
    }
}

#[test]
fn nrrd_segment_names_become_label_names() {
    let header = "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 2 1\nencoding: raw\nSegment0_Name:=femur\nSegment0_LabelValue:=3\nSegment1_LabelValue:=4\n\n\x03\x03\x04\x00";
    let volume = read("a.nrrd", header.as_bytes(), &[]).unwrap();
    assert!(volume.label_names.into_iter().eq([(3, "femur".to_owned())]));
}

/// Returns every variant of every format, small.
fn all_files() -> Vec<crate::io::volume_files::File> {
    let image = Image::new(ScalarType::I16);
    let writers = [nrrd, metaimage, nifti];
    let each = PLACES.iter().flat_map(|p| writers.map(|w| (w, *p)));
    each.map(|(write, place)| write(&image, true, place))
        .collect()
}

fn parse(file: &crate::io::volume_files::File, bytes: &[u8]) -> Result<Volume, String> {
    let beside = file.beside.first().map_or(&[][..], |(_, bytes)| bytes);
    io::fuzz::Readers::volume(bytes, beside)
}

#[test]
fn rejects_volume_truncated_at_any_byte() {
    for file in all_files() {
        let whole = parse(&file, &file.bytes).unwrap();
        for cut in 0..file.bytes.len() {
            let Ok(volume) = parse(&file, &file.bytes[..cut]) else {
                continue;
            };
            let tail = &file.bytes[cut..];
            // A missing line end is undetectable, and so are data counted from the end of a file
            // with a prefix; and here any part of a data file's name finds its bytes.
            let from_the_end = [&b"byte skip: -1"[..], b"HeaderSize = -1"];
            let from_the_end = from_the_end
                .iter()
                .any(|line| file.bytes.windows(line.len()).any(|w| w == *line));
            let named = file.beside.first().map_or(1, |(name, _)| name.len());
            let harmless = tail.len() <= if from_the_end { 9.max(named) } else { named };
            assert!(
                harmless,
                "{} truncated at {cut} of {} is accepted",
                file.name,
                file.bytes.len()
            );
            assert_eq!(volume.size, whole.size);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]
    #[test]
    fn damaged_volumes_never_panic(
        which in 0usize..18,
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let file = &all_files()[which];
        let mut bytes = file.bytes.clone();
        for (at, byte) in damage {
            let at = at.index(bytes.len());
            bytes[at] = byte;
        }
        if let Ok(volume) = parse(file, &bytes) {
            prop_assert_eq!(volume.raw.len(), volume.voxels());
            prop_assert!(volume.to_world.matrix3.determinant() != 0.0);
            VolumeDescription::new(&volume).to_string();
        }
    }
}

/// Returns an oblique volume of f(p) = 3x − 2y + z + 1.
fn linear() -> (Volume, impl Fn(DVec3) -> f64) {
    let f = |p: DVec3| 3.0 * p.x - 2.0 * p.y + p.z + 1.0;
    let mut volume = Image::new(ScalarType::F64).volume();
    let values = (0..24).map(|n| f(volume.centre(n % 3, n / 3 % 4, n / 12)));
    volume.raw = Raw::F64(values.collect());
    (volume, f)
}

#[test]
fn sampling_is_trilinear_and_clamped_at_border() {
    let (volume, f) = linear();
    for at in [[0.25, 0.5, 0.75], [1.999, 2.5, 0.0], [2.0, 3.0, 1.0]] {
        let p = volume.to_world.transform_point3(DVec3::from(at));
        assert!((volume.sample(p) - f(p)).abs() < 1e-9);
    }
    let outside = volume.to_world.transform_point3(DVec3::new(-4.0, 1.0, 9.0));
    let border = volume.centre(0, 1, 1);
    assert!((volume.sample(outside) - f(border)).abs() < 1e-9);
}

#[test]
fn node_values_are_means_on_coarse_and_samples_on_fine_meshes() {
    // Stripes of 0 and 100, one voxel wide.
    let size = [32, 32, 32];
    let values = (0..32 * 32 * 32).map(|n| 100 * (n % 2) as u8);
    let volume = Volume {
        size,
        raw: Raw::U8(values.collect()),
        to_world: DAffine3::IDENTITY,
        ..Image::new(ScalarType::U8).volume()
    };
    let tet = |edge: f64| {
        let base = DVec3::splat(16.0);
        let nodes = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].map(|p| base + edge * p);
        let mesh = TetMesh::new(nodes.to_vec(), vec![[0, 1, 2, 3]], Vec::new(), Vec::new());
        volume.onto_nodes(&mesh.unwrap(), "stripes").values
    };
    assert_eq!(tet(0.5), [0.0, 50.0, 0.0, 0.0]);
    for mean in tet(8.0) {
        assert!((mean - 50.0).abs() < 13.0, "{mean}");
    }
}

#[test]
fn volumes_with_fractional_values_have_no_labels() {
    let mut volume = Image::new(ScalarType::F64).volume();
    volume.raw = Raw::F64((0..24).map(|n| f64::from(n % 5)).collect());
    assert_eq!(volume.labels().unwrap()[&4], 4);
    for odd in [0.5, f64::NAN, f64::INFINITY, 1e300] {
        let mut values: Vec<f64> = (0..24).map(|n| f64::from(n % 5)).collect();
        values[7] = odd;
        volume.raw = Raw::F64(values);
        assert!(volume.labels().is_none(), "{odd}");
    }
}

#[test]
fn volume_report_states_orientation_and_labels() {
    let Some(knee) = real("knee_labels_dess_384x384x160.nrrd") else {
        return;
    };
    let knee = VolumeDescription::new(&knee);
    assert_eq!(knee.labels.len(), 11);
    assert_eq!(knee.labels[1].voxels, 127_311);
    assert!(knee.obliquity_degrees > 0.1 && knee.obliquity_degrees < 15.0);
    let Some(ct) = real("headsq_ct_64x64x93.mhd") else {
        return;
    };
    let ct = VolumeDescription::new(&ct);
    assert_eq!(
        (ct.orientation.as_str(), ct.obliquity_degrees),
        ("LPS", 0.0)
    );
}

#[test]
fn rejects_gzip_without_volume() {
    let error = read("a.nii.gz", &gzip(b"nothing of the kind"), &[]).unwrap_err();
    assert!(error.to_string().contains("NIfTI header"), "{error}");
    assert!(io::fuzz::Readers::volume(&[], &[]).is_err());
}
