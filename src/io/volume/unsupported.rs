//! Volume formats that are not read: their names, and what converts them.

/// Formats by extension, with their names and a remedy.
const BY_EXTENSION: [(&[&str], &str, &str); 17] = [
    (
        &["mnc", "mnc2"],
        "a MINC volume",
        "convert it with `mnc2nii IN.mnc OUT.nii` or nibabel",
    ),
    (
        &["brik", "head"],
        "an AFNI volume",
        "convert it with `3dAFNItoNIFTI`",
    ),
    (
        &["mif", "mih"],
        "an MRtrix volume",
        "convert it with `mrconvert IN.mif OUT.nii.gz`",
    ),
    (
        &["gipl"],
        "a GIPL volume",
        "convert it to .nii.gz with ITK-SNAP or SimpleITK",
    ),
    (
        &["par", "rec"],
        "a Philips PAR/REC volume",
        "convert it with dcm2niix or `parrec2nii` (nibabel)",
    ),
    (
        &["bxh", "xcede"],
        "a BXH/XCEDE header",
        "name its data file, or convert it with `bxh2analyze --niigz`",
    ),
    (
        &["hv", "h33", "i33"],
        "an Interfile volume",
        "convert it with `medcon -c nifti`",
    ),
    (
        &["dcm", "dicom", "ima"],
        "a DICOM file without `DICM` at byte 128, or none",
        "add the header with `dcmconv +F` (DCMTK), or convert it with dcm2niix",
    ),
    (
        &["mrb", "mrml"],
        "a scene of 3D Slicer",
        "open it in 3D Slicer and save its volume as .nrrd",
    ),
    (
        &["tif", "tiff"],
        "a TIFF image",
        "save the stack as .nrrd with Fiji or 3D Slicer",
    ),
    (
        &["png", "jpg", "jpeg", "bmp"],
        "a flat picture",
        "load the stack of pictures in 3D Slicer or Fiji and save it as .nrrd",
    ),
    (
        &["czi", "lif", "nd2", "ims", "oib", "lsm"],
        "a microscope's image",
        "save it as .nrrd with Fiji (Bio-Formats)",
    ),
    (
        &["npy", "npz"],
        "an array of NumPy",
        "in Python use `palpate.Volume(array, affine)`",
    ),
    (
        &["raw", "zraw"],
        "voxels without a header",
        "name the header beside it (.mhd or .nhdr)",
    ),
    (
        &["img"],
        "voxels without a header",
        "its header, the .hdr of the same name, must be beside it",
    ),
    (&["zip"], "an archive", "extract it first (`unzip`)"),
    (
        &["h5", "hdf5"],
        "an HDF5 file",
        "save its volume as .nii.gz or .nrrd with the program that wrote it",
    ),
];

/// Formats by their first bytes.
const BY_CONTENT: [(&[u8], &str, &str); 8] = [
    (
        b"CDF\x01",
        "a netCDF file, such as MINC 1",
        "convert it with `mnc2nii IN.mnc OUT.nii` or nibabel",
    ),
    (
        b"CDF\x02",
        "a netCDF file, such as MINC 1",
        "convert it with `mnc2nii IN.mnc OUT.nii` or nibabel",
    ),
    (
        b"\x89HDF\r\n\x1a\n",
        "an HDF5 file, such as MINC 2",
        "convert it with `mnc2nii IN.mnc OUT.nii` or nibabel, if it is MINC",
    ),
    (
        b"mrtrix image",
        "an MRtrix volume",
        "convert it with `mrconvert IN.mif OUT.nii.gz`",
    ),
    (
        b"!INTERFILE",
        "an Interfile volume",
        "convert it with `medcon -c nifti`",
    ),
    (
        b"MATRIX7",
        "an ECAT volume",
        "convert it with nibabel or `medcon -c nifti`",
    ),
    (
        b"\xfd7zXZ\0",
        "compressed with xz",
        "decompress it first (`unxz`); only gzip and bzip2 are read as they are",
    ),
    (
        b"\x28\xb5\x2f\xfd",
        "compressed with zstd",
        "decompress it first (`unzstd`); only gzip and bzip2 are read as they are",
    ),
];

/// Returns the error for a volume in a format that is not supported.
pub(super) fn format_of(bytes: &[u8], extension: &str) -> Option<String> {
    let content = BY_CONTENT
        .iter()
        .find(|(magic, ..)| bytes.starts_with(magic));
    let named = BY_EXTENSION
        .iter()
        .find(|(all, ..)| all.contains(&extension));
    let found = content.map(|(_, name, remedy)| (name, remedy));
    let (name, remedy) = found.or(named.map(|(_, name, remedy)| (name, remedy)))?;
    Some(format!(
        "the file is {name}, which Palpate does not read; {remedy}"
    ))
}
