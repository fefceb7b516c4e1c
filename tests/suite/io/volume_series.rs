//! Files of several volumes: times, components, and the layers of segmentations.

use crate::support::real_data;
use palpate::io;
use palpate::volume::Volume;

fn read(name: &str, bytes: &[u8], number: Option<usize>) -> palpate::Result<Volume> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    io::read_volume_number(path, number)
}

fn values(volume: &Volume) -> Vec<f64> {
    (0..volume.voxels()).map(|n| volume.value(n)).collect()
}

#[test]
fn one_of_several_volumes_reads_by_its_number() {
    let Some(path) = real_data("cases/20_n_4d.nii.gz") else {
        return;
    };
    for (number, sum) in [(0, 301_800.0), (1, 309_720.0), (2, 317_640.0)] {
        let volume = io::read_volume_number(&path, Some(number)).unwrap();
        assert_eq!(values(&volume).iter().sum::<f64>(), sum);
        assert_eq!(volume.size, [18, 20, 22]);
    }
    let error = io::read_volume(&path).unwrap_err().to_string();
    let parts = ["3 volumes", "--volume", "0 to 2"];
    assert!(parts.iter().all(|p| error.contains(p)), "{error}");
    let error = io::read_volume_number(&path, Some(3)).unwrap_err();
    assert!(error.to_string().contains("[0, 2]"), "{error}");
}

#[test]
fn components_and_times_read_alike_in_all_formats() {
    let nrrd = |sizes: &str, more: &str| {
        format!("NRRD0004\ntype: uint8\ndimension: 4\nsizes: {sizes}\n{more}encoding: raw\n\n")
    };
    let meta = |more: &str| {
        format!(
            "ObjectType = Image\nNDims = 3\nDimSize = 2 2 1\n{more}ElementType = MET_UCHAR\n\
             ElementDataFile = LOCAL\n"
        )
    };
    let data: Vec<u8> = (1..=12).collect();
    let components = [[1, 4, 7, 10], [2, 5, 8, 11], [3, 6, 9, 12]];
    let times = [[1, 2, 3, 4], [5, 6, 7, 8], [9, 10, 11, 12]];
    let directions = "space directions: none (1,0,0) (0,1,0) (0,0,1)\nspace: RAS\n";
    let last = "space directions: (1,0,0) (0,1,0) (0,0,1) none\nspace: RAS\n";
    let kinds = "kinds: vector domain domain domain\n";
    let ascii = "type: uint8\ndimension: 4\nsizes: 3 2 2 1\nencoding: ascii\n";
    let text = format!("NRRD0004\n{ascii}{kinds}\n1 2 3 4 5 6 7 8 9 10 11 12\n");
    let of_channels = meta("ElementNumberOfChannels = 3\n");
    let of_times = meta("").replace("NDims = 3", "NDims = 4");
    let of_times = of_times.replace("DimSize = 2 2 1", "DimSize = 2 2 1 3");
    for (name, header, expected) in [
        ("a.nrrd", nrrd("3 2 2 1", directions), components),
        ("a.nrrd", nrrd("3 2 2 1", kinds), components),
        ("a.nrrd", nrrd("2 2 1 3", last), times),
        ("a.nrrd", text, components),
        ("a.mha", of_channels, components),
        ("a.mha", of_times, times),
    ] {
        let bytes = [header.as_bytes(), &data].concat();
        for (number, expected) in expected.iter().enumerate() {
            let volume = read(name, &bytes, Some(number));
            let volume = volume.unwrap_or_else(|e| panic!("{header}: {e}"));
            assert_eq!(values(&volume), expected.map(f64::from), "{header}");
            assert_eq!(volume.size, [2, 2, 1]);
        }
        let error = read(name, &bytes, None).unwrap_err().to_string();
        assert!(error.contains("3 volumes"), "{error}");
    }
}

#[test]
fn layers_of_a_segmentation_become_one_label_map() {
    let Some(path) = real_data("cases/21_r_layers.seg.nrrd") else {
        return;
    };
    let volume = io::read_volume(&path).unwrap();
    let labels = volume.labels().unwrap();
    assert!(
        labels
            .into_iter()
            .eq([(0, 6832), (1, 476), (2, 476), (3, 136)])
    );
    let names: Vec<&str> = volume.label_names.values().map(String::as_str).collect();
    assert_eq!(names, ["liver", "kidney", "tumour"]);
    assert_eq!(volume.to_world.matrix3.z_axis.z, 3.0);
    let notes = volume.notes.join("\n");
    for part in [
        "tumour is label 3 (value 1 of layer 1)",
        "tumour over liver in 68 voxels",
        "tumour over kidney in 68 voxels",
    ] {
        assert!(notes.contains(part), "{notes}");
    }
    let layer = io::read_volume_number(&path, Some(1)).unwrap();
    assert!(
        layer
            .labels()
            .unwrap()
            .into_iter()
            .eq([(0, 7784), (1, 136)])
    );
    assert!(layer.label_names.into_iter().eq([(1, "tumour".to_owned())]));
}

#[test]
fn segments_have_names_values_and_colours() {
    let header = |sizes: &str, keys: &str| {
        let dimension = sizes.split(' ').count();
        format!(
            "NRRD0004\ntype: uint8\ndimension: {dimension}\nsizes: {sizes}\nkinds: {}domain \
             domain domain\nencoding: raw\n{keys}\n",
            if dimension == 4 { "list " } else { "" }
        )
    };
    let keys = "Segment1_LabelValue:=7\nSegment1_ID:=Seg_1\nSegment1_Color:=0.5 0 1\n\
                Segment0_LabelValue:=3\nSegment0_Name:=bone\nSegment0_Color:=none\n";
    let single = [header("2 2 1", keys).as_bytes(), &[3, 7, 0, 7]].concat();
    let volume = read("a.seg.nrrd", &single, None).unwrap();
    assert_eq!(volume.label_names[&3], "bone");
    assert_eq!(volume.label_names[&7], "Seg_1");
    assert!(volume.label_colours.into_iter().eq([(7, [0.5, 0.0, 1.0])]));
    assert!(volume.notes.is_empty());

    // Slicer 4.10 wrote a layer per segment; a value that no segment names gets a label of its own.
    let keys = "Segment0_Name:=a\nSegment1_Name:=b\n";
    let layers = [
        header("2 2 2 1", keys).as_bytes(),
        &[1, 0, 0, 1, 1, 1, 9, 0],
    ]
    .concat();
    let volume = read("b.seg.nrrd", &layers, None).unwrap();
    assert_eq!(values(&volume), [1.0, 2.0, 2.0, 3.0]);
    assert_eq!(volume.label_names[&2], "b");
    let notes = volume.notes.join("\n");
    assert!(notes.contains("b over a in 1 voxels"), "{notes}");
}
