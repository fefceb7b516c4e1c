//! Output files of warped scans and displacement fields.

use super::{around, grid, scan};
use flate2::read::GzDecoder;
use glam::DVec3;
use palpate::io::read_volume;
use palpate::mesh::TetMesh;
use palpate::volume::{Raw, Volume};
use palpate::warp::{Warp, WarpFiles, WarpOptions};
use std::io::Read;
use std::path::Path;

fn ball() -> Volume {
    let middle = grid().centre(12, 9, 8);
    let near = |p: DVec3| (1000.0 - 100.0 * p.distance(middle)) as i16;
    scan(
        grid(),
        Raw::I16(super::centres(&grid()).into_iter().map(near).collect()),
    )
}

fn pushed() -> (TetMesh, Vec<DVec3>) {
    let rest = around(&grid(), [3, 3, 3]);
    let bent = rest.nodes.iter().map(|p| *p + DVec3::new(1.25, -2.5, 3.75));
    let bent = bent.collect();
    (rest, bent)
}

fn unpacked(bytes: &[u8]) -> Vec<u8> {
    let mut all = Vec::new();
    GzDecoder::new(bytes).read_to_end(&mut all).unwrap();
    all
}

fn reals(bytes: &[u8]) -> Vec<f32> {
    let numbers = bytes.chunks_exact(4);
    numbers
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect()
}

#[test]
fn every_format_stores_image_and_lps_vectors() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, (rest, bent)) = (ball(), pushed());
    let warp = Warp::new(&rest, &bent).unwrap();
    let expected = warp.image(&scan, &grid(), &WarpOptions::default()).unwrap();
    let voxels = grid().voxels();
    // Rest minus bent is (−1.25, 2.5, −3.75) in RAS.
    let lps = [1.25f32, -2.5, -3.75];
    for extension in ["nii.gz", "nrrd", "mha"] {
        let path = |name: &str| folder.path().join(format!("{name}.{extension}"));
        let (image, inverse) = (path("image"), path("inverse"));
        let files = WarpFiles {
            image: Some(&image),
            inverse: Some(&inverse),
            displacement: None,
        };
        let options = WarpOptions::default();
        let mut planes = Vec::new();
        let mut progress = |done: usize, all: usize| {
            planes.push((done, all));
            // A reader, or an interrupted run, finds no incomplete file.
            assert!(!image.exists() && !inverse.exists());
        };
        let report = warp
            .write(&scan, &grid(), &options, &files, &mut progress)
            .unwrap();
        assert_eq!(report.bent, Some(expected.coverage));
        assert_eq!(report.rest, None);
        assert_eq!(planes, (1..=16).map(|n| (n, 16)).collect::<Vec<_>>());
        let read = read_volume(&image).unwrap();
        assert!(read.to_world.abs_diff_eq(grid().to_world, 1e-4));
        assert_eq!(read.raw.scalar_type(), expected.volume.raw.scalar_type());
        for n in 0..voxels {
            assert_eq!(read.raw.get(n), expected.volume.raw.get(n));
        }
        let bytes = std::fs::read(&inverse).unwrap();
        match extension {
            "nii.gz" => {
                let bytes = unpacked(&bytes);
                let short = |at: usize| i16::from_le_bytes([bytes[at], bytes[at + 1]]);
                let sizes: Vec<i16> = (0..8).map(|n| short(40 + 2 * n)).collect();
                assert_eq!(sizes, [5, 24, 20, 16, 1, 3, 1, 1]);
                assert_eq!((short(68), short(70), short(72)), (1007, 16, 32));
                let vectors = reals(&bytes[352..]);
                assert_eq!(vectors.len(), 3 * voxels);
                // Component by component.
                for (part, value) in vectors.chunks(voxels).zip(lps) {
                    assert!(part.iter().all(|x| (x - value).abs() < 1e-5), "{value}");
                }
            }
            "nrrd" => {
                let end = bytes.windows(2).position(|w| w == b"\n\n").unwrap();
                let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
                for line in [
                    "space: left-posterior-superior",
                    "sizes: 3 24 20 16",
                    "kinds: vector domain domain domain",
                    "space directions: none (",
                    "type: float",
                ] {
                    assert!(header.contains(line), "{header}");
                }
                interleaved(&unpacked(&bytes[end + 2..]), lps);
            }
            _ => {
                let mark = b"ElementDataFile = LOCAL\n";
                let end = bytes.windows(mark.len()).position(|w| w == mark).unwrap();
                let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
                assert!(header.contains("ElementNumberOfChannels = 3\n"), "{header}");
                let mut all = Vec::new();
                let mut packed = flate2::read::ZlibDecoder::new(&bytes[end + mark.len()..]);
                packed.read_to_end(&mut all).unwrap();
                interleaved(&all, lps);
            }
        }
    }
}

fn interleaved(bytes: &[u8], vector: [f32; 3]) {
    let found = reals(bytes);
    assert_eq!(found.len(), 3 * grid().voxels());
    for found in found.chunks(3) {
        let off = found.iter().zip(vector).map(|(a, b)| (a - b).abs());
        assert!(off.fold(0.0, f32::max) < 1e-5, "{found:?}");
    }
}

#[test]
fn outputs_use_their_grids() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, (rest, bent)) = (ball(), pushed());
    let warp = Warp::new(&rest, &bent).unwrap();
    let mut other = grid();
    other.size = [10, 11, 12];
    let [image, displacement, inverse] =
        ["a.nii.gz", "b.nii.gz", "c.nii.gz"].map(|name| folder.path().join(name));
    let files = WarpFiles {
        image: Some(&image),
        displacement: Some(&displacement),
        inverse: Some(&inverse),
    };
    let options = WarpOptions::default();
    let report = warp
        .write(&scan, &other, &options, &files, &mut |_, _| {})
        .unwrap();
    assert_eq!(report.bent.unwrap().voxels, 10 * 11 * 12);
    assert_eq!(report.rest.unwrap().voxels, 24 * 20 * 16);
    assert_eq!(report.inverted, 0);
    let values = |path: &Path, n: usize| {
        let bytes = unpacked(&std::fs::read(path).unwrap());
        let vectors = reals(&bytes[352..]);
        assert_eq!(vectors.len(), 3 * n);
        [vectors[0], vectors[n], vectors[2 * n]]
    };
    let close = |found: [f32; 3], wanted: [f32; 3]| {
        assert!(
            found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-5),
            "{found:?}"
        );
    };
    close(values(&displacement, 24 * 20 * 16), [-1.25, 2.5, 3.75]);
    close(values(&inverse, 10 * 11 * 12), [1.25, -2.5, -3.75]);
    assert_eq!(read_volume(&image).unwrap().size, other.size);
}

#[test]
fn failed_write_leaves_existing_files_unchanged() {
    let folder = tempfile::tempdir().unwrap();
    let (scan, (rest, bent)) = (ball(), pushed());
    let [image, inverse, bad] =
        ["a.nii.gz", "b.nrrd", "c.txt"].map(|name| folder.path().join(name));
    std::fs::write(&inverse, "older").unwrap();
    let left = || {
        let names = std::fs::read_dir(folder.path()).unwrap();
        let mut names: Vec<_> = names.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["b.nrrd"]);
        assert_eq!(std::fs::read(&inverse).unwrap(), b"older");
    };
    let refused = |warp: &Warp, image: &Path, inverse: &Path| {
        let files = WarpFiles {
            image: Some(image),
            inverse: Some(inverse),
            displacement: None,
        };
        let options = WarpOptions::default();
        let done = warp.write(&scan, &scan.grid(), &options, &files, &mut |_, _| {});
        left();
        done.unwrap_err().to_string()
    };
    let warp = Warp::new(&rest, &bent).unwrap();
    let message = refused(&warp, &bad, &inverse);
    assert!(
        message.contains("c.txt") && message.contains(".nii.gz"),
        "{message}"
    );
    let message = refused(&warp, &folder.path().join("none/a.mha"), &inverse);
    assert!(
        message.contains("output folder") && message.contains("create it first"),
        "{message}"
    );
    let message = refused(&warp, &inverse, &inverse);
    assert!(message.contains("two outputs"), "{message}");
    // All planes are processed before it is known that none intersects the body.
    let far: Vec<DVec3> = bent.iter().map(|p| *p + 900.0).collect();
    let message = refused(&Warp::new(&rest, &far).unwrap(), &image, &inverse);
    assert!(message.contains("no voxel is inside the body"), "{message}");
    let nothing = WarpFiles::default().check().unwrap_err().to_string();
    assert!(nothing.contains("no output file"), "{nothing}");
}
