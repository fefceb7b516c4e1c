//! Volumes as programs really write them: headers with gaps, pairs, compressed files, other formats.

use crate::io::volume_files::{Image, Place, gzip, metaimage, nifti, nrrd};
use crate::support::real_data;
use glam::DVec3;
use palpate::io::{self, Kind};
use palpate::mesh::ScalarType;
use palpate::volume::{Raw, Volume};

/// The sum of the values of the image that most case files hold.
const SUM: f64 = 301_800.0;
/// Their position: that of the first voxel and of voxel (1, 2, 3).
const PLACE: [[f64; 3]; 2] = [[30.0, -20.0, 5.0], [28.0, -17.0, 14.0]];

fn sum(volume: &Volume) -> f64 {
    (0..volume.voxels()).map(|n| volume.value(n)).sum()
}

fn placed(volume: &Volume, [first, other]: [[f64; 3]; 2], what: &str) {
    for ([i, j, k], at) in [([0, 0, 0], first), ([1, 2, 3], other)] {
        let centre = volume.centre(i, j, k);
        let off = centre.distance(DVec3::from(at));
        assert!(off < 1e-5, "{what}: ({i}, {j}, {k}) is at {centre}");
    }
}

fn case(name: &str) -> Option<Volume> {
    let path = real_data(&format!("cases/{name}"))?;
    assert_eq!(io::detect_kind(&path).unwrap(), Kind::Volume, "{name}");
    let volume = io::read_volume(&path).unwrap_or_else(|e| panic!("{name}: {e}"));
    assert_eq!(volume.size[2], 22, "{name}");
    Some(volume)
}

#[test]
fn odd_headers_read_with_the_values_and_place_of_the_sound_one() {
    for (name, note) in [
        ("20_n_ok.nii.gz", None),
        ("20_n_sform_zero.nii.gz", Some("qform was used")),
        ("20_n_dim4_zero.nii.gz", Some("`dim[4]` is 0")),
        ("20_n_trailing100.nii", Some("100 bytes")),
        ("20_a_pair.hdr", None),
        ("20_a_pair.img", None),
        ("20_a_pairgz.hdr.gz", None),
        ("20_a_pairgz.img.gz", None),
        ("20_a_vol.mgz", None),
        ("21_r_on_nii.nhdr", None),
    ] {
        let Some(volume) = case(name) else { return };
        assert_eq!(sum(&volume), SUM, "{name}");
        placed(&volume, PLACE, name);
        match note {
            None => assert!(volume.notes.is_empty(), "{name}: {:?}", volume.notes),
            Some(part) => {
                assert!(volume.notes[0].contains(part), "{name}: {:?}", volume.notes);
            }
        }
    }
}

#[test]
fn spacing_of_zero_and_other_worlds_match_other_readers() {
    for (name, place) in [
        // The third spacing is taken for 1; its axis runs down, since `pixdim[0]` is 1.
        (
            "20_n_pixdim_zero.nii.gz",
            [[30.0, -20.0, 5.0], [28.0, -17.0, 2.0]],
        ),
        // Centred, and the first index runs to the left, as in nibabel.
        (
            "20_a_analyze.hdr",
            [[17.0, -14.25, -31.5], [15.0, -11.25, -22.5]],
        ),
        (
            "20_a_analyze.img",
            [[17.0, -14.25, -31.5], [15.0, -11.25, -22.5]],
        ),
        // LPS, at (1, 2, 3).
        ("21_m_percent.mhd", [[-1.0, -2.0, 3.0], [-3.0, -5.0, 12.0]]),
        ("21_r_microns.nrrd", [[0.0; 3], [0.76, 1.14, 3.42]]),
        ("21_r_bz2.nrrd", [[0.0; 3], [2.0, 3.0, 9.0]]),
    ] {
        let Some(volume) = case(name) else { return };
        assert_eq!(sum(&volume), SUM, "{name}");
        placed(&volume, place, name);
        let noted = name.starts_with("20_");
        assert_eq!(
            volume.notes.is_empty(),
            !noted,
            "{name}: {:?}",
            volume.notes
        );
    }
}

#[test]
fn labels_near_integers_are_a_label_map() {
    let Some(path) = real_data("cases/08_labels_scaled.nii.gz") else {
        return;
    };
    let volume = io::read_volume(path).unwrap();
    let labels = volume.labels().unwrap();
    assert!(labels.into_iter().eq([(0, 1832), (1, 456), (2, 456)]));
    assert_eq!(volume.notes.len(), 1);
    assert!(volume.notes[0].contains("label map"), "{:?}", volume.notes);
}

/// Returns a volume of eight values with a slope.
fn eight(raw: Raw, slope: f64) -> Volume {
    Volume {
        size: [2; 3],
        raw,
        slope,
        ..Volume::default()
    }
}

#[test]
fn only_label_maps_are_rounded() {
    let floats = |values: [f64; 8]| eight(Raw::F64(values.to_vec()), 1.0);
    let mut near = floats([0.0, 1.0002, 2.9999, 1e-5, 0.0, 1.0, 3.0, 3.0]);
    near.round_near_labels();
    assert_eq!(near.labels().unwrap()[&3], 3);
    assert_eq!(near.raw.scalar_type(), ScalarType::U8);
    for values in [
        // Displacements in metres, values of a scan, and integers, which need no rounding.
        [0.0, 1e-4, 2e-4, 3e-4, -1e-4, 0.0, 5e-5, 6e-5],
        [0.0, 1.0, 2.01, 3.0, 4.0, 5.0, 6.0, 7.0],
        [0.0, 1.0, 2.0, 3.0, 4.0, f64::NAN, 6.0, 7.0],
        [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0],
    ] {
        let mut volume = floats(values);
        volume.round_near_labels();
        assert!(matches!(volume.raw, Raw::F64(_)) && volume.notes.is_empty());
    }
    // Labels up to 200 in steps of a scaling; then consecutive values of a fine scaling.
    let step = 200.0 / 32767.0;
    let stored = |label: f64| (label / step).round() as i16;
    let labels = [0.0, 7.0, 7.0, 33.0, 199.0, 200.0, 0.0, 1.0];
    let mut scaled = eight(Raw::I16(labels.map(stored).to_vec()), step);
    scaled.round_near_labels();
    assert!(
        (0..8).all(|n| scaled.value(n) == labels[n]),
        "{:?}",
        scaled.raw
    );
    let mut fine = eight(Raw::I16(vec![163, 164, 165, 164, 163, 0, 0, 0]), step);
    fine.round_near_labels();
    assert_eq!(fine.slope, step);
}

/// Writes `files` to a folder and reads the first, or `name`.
fn read(files: &[(&str, &[u8])], name: &str) -> palpate::Result<Volume> {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    io::read_volume(folder.path().join(name))
}

#[test]
fn every_format_reads_compressed() {
    let image = Image::new(ScalarType::I16);
    for (name, file) in [
        ("a.nrrd.gz", nrrd(&image, false, Place::Attached)),
        ("a.mha.gz", metaimage(&image, false, Place::Attached)),
        ("a.nii.gz", nifti(&image, true, Place::Attached)),
    ] {
        let packed = gzip(&file.bytes);
        let volume = read(&[(name, &packed)], name).unwrap();
        assert_eq!(volume.raw.get(3), image.values[3], "{name}");
        let error = read(&[(name, &packed[..packed.len() / 2])], name).unwrap_err();
        assert!(error.to_string().contains(name), "{error}");
    }
}

#[test]
fn images_name_their_missing_header_and_headers_their_missing_image() {
    let file = nifti(&Image::new(ScalarType::U8), false, Place::Beside);
    let error = read(&[("a.hdr.gz", &gzip(&file.bytes))], "a.hdr.gz").unwrap_err();
    assert!(error.to_string().contains("a.img.gz"), "{error}");
    let (_, voxels) = &file.beside[0];
    let error = read(&[("a.img", voxels)], "a.img").unwrap_err();
    assert!(
        error.to_string().contains(".hdr of the same name"),
        "{error}"
    );
    for (header, data) in [
        ("a.HDR", "a.IMG"),
        ("a.hdr", "a.img.gz"),
        ("a.hdr.gz", "a.img"),
    ] {
        let bytes = match header.ends_with(".gz") {
            true => gzip(&file.bytes),
            false => file.bytes.clone(),
        };
        let packed = match data.ends_with(".gz") {
            true => gzip(voxels),
            false => voxels.clone(),
        };
        for name in [header, data] {
            let volume = read(&[(header, &bytes), (data, &packed)], name);
            let volume = volume.unwrap_or_else(|e| panic!("{header}, {data}: {e}"));
            assert_eq!(volume.raw.scalar_type(), ScalarType::U8);
        }
    }
}

#[test]
fn units_of_nrrd_have_many_names() {
    for (units, mm) in [
        ("\"mm\" \"millimeter\" \"Millimetres\"", 1.0),
        ("\"microns\" \"micron\" \"µm\"", 1e-3),
        ("\"um\" \"μm\" \"micrometers\"", 1e-3),
        ("\"meters\" \"m\" \"metre\"", 1e3),
        ("\"centimeters\" \"cm\" \"cm\"", 10.0),
        ("\"\" \"\" \"\"", 1.0),
        ("\"nm\" \"nanometers\" \"nm\"", 1e-6),
        ("\"inches\" \"in\" \"inch\"", 25.4),
    ] {
        let header = format!(
            "NRRD0004\ntype: uint8\ndimension: 3\nsizes: 2 1 1\nspace: RAS\nspace directions: \
             (1,0,0) (0,1,0) (0,0,1)\nspace units: {units}\nencoding: raw\n\nab"
        );
        let volume = read(&[("a.nrrd", header.as_bytes())], "a.nrrd");
        let volume = volume.unwrap_or_else(|e| panic!("{units}: {e}"));
        assert!(
            (volume.spacing() / mm - 1.0).abs().max_element() < 1e-9,
            "{units}"
        );
    }
}

#[test]
fn unsupported_formats_are_named_with_a_converter() {
    let long = [b"\x89HDF\r\n\x1a\n".as_slice(), &[0; 200]].concat();
    for (name, bytes, parts) in [
        ("a.mnc", long.as_slice(), ["MINC", "mnc2nii"]),
        ("a.mnc", b"CDF\x01\0\0", ["MINC", "nibabel"]),
        ("a+orig.BRIK", b"\x01\x02\x03", ["AFNI", "3dAFNItoNIFTI"]),
        (
            "a.mif",
            b"mrtrix image\ndim: 2,2,2",
            ["MRtrix", "mrconvert"],
        ),
        ("a.par", b"# Philips", ["PAR/REC", "dcm2niix"]),
        ("a.tif", b"II*\0", ["TIFF", "Slicer"]),
        ("a.raw", b"\0\0\0\x01", ["header", ".mhd"]),
        ("a.nii.xz", b"\xfd7zXZ\0\0", ["xz", "unxz"]),
        ("a.dcm", b"none at all", ["DICM", "dcmconv"]),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        let error = io::read(&path).unwrap_err().to_string();
        assert!(parts.iter().all(|p| error.contains(p)), "{name}: {error}");
        let error = io::read_volume(&path).unwrap_err().to_string();
        assert!(parts.iter().all(|p| error.contains(p)), "{name}: {error}");
    }
}

#[test]
fn bytes_of_a_further_volume_are_an_error() {
    let file = nifti(&Image::new(ScalarType::U8), false, Place::Attached);
    let more = |count: usize| [file.bytes.as_slice(), &vec![0; count]].concat();
    let voxels = Image::new(ScalarType::U8).values.len();
    let volume = read(&[("a.nii", &more(voxels - 1))], "a.nii").unwrap();
    assert!(volume.notes[0].contains("bytes after the voxels"));
    let error = read(&[("a.nii", &more(voxels))], "a.nii").unwrap_err();
    assert!(error.to_string().contains("has more"), "{error}");
}
