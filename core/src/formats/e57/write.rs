//! Writing scans and pictures into a new E57 file.

use std::error::Error;
use std::fs::File;
use std::io::{self, Cursor};
use std::path::Path;

use ::e57::{
    CylindricalImageProperties, E57Writer, ImageFormat, PinholeImageProperties, Quaternion, Record,
    SphericalImageProperties, Transform, Translation, VisualReferenceImageProperties,
};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion};

use super::columns::{Columns, Matrix, ScanData};

/// How a picture was projected, in E57's own terms.
#[derive(Clone, Copy)]
pub enum PhotoModel {
    /// For show only.
    VisualReference,
    /// Focal length and pixel size in metres, principal point in pixels.
    Pinhole {
        focal: f64,
        pixel: [f64; 2],
        principal: [f64; 2],
    },
    /// Pixel size in radians.
    Spherical { pixel: [f64; 2] },
    /// Radius in metres, pixel width in radians, pixel height in metres, principal row in pixels.
    Cylindrical {
        radius: f64,
        pixel: [f64; 2],
        principal_y: f64,
    },
}

/// One picture to write.
pub struct Photo<'a> {
    pub name: &'a str,
    pub guid: &'a str,
    /// The scan it belongs to.
    pub scan_guid: &'a str,
    /// File coordinates from E57's camera frame.
    pub pose: Option<Matrix>,
    pub png: bool,
    pub data: &'a [u8],
    pub width: u32,
    pub height: u32,
    pub model: PhotoModel,
}

/// Writes one file, scan after scan.
pub struct Writer {
    inner: E57Writer<File>,
}

/// Stands for the file's identity until all scans are known.
const NO_GUID: &str = "{00000000-0000-0000-0000-000000000000}";

impl Writer {
    /// Creates the file, or empties it.
    pub fn create(path: &Path) -> io::Result<Self> {
        Ok(Self {
            inner: E57Writer::from_file(path, NO_GUID).map_err(refusal)?,
        })
    }

    /// Names the coordinate reference system, as WKT where it is known so.
    pub fn set_coordinates(&mut self, text: &str) {
        self.inner.set_coordinate_metadata(Some(cdata(text)));
    }

    /// Appends a scan.
    pub fn add_scan(&mut self, scan: &ScanData) -> io::Result<()> {
        self.put_scan(scan).map_err(refusal)
    }

    fn put_scan(&mut self, scan: &ScanData) -> e57::Result<()> {
        let columns = Columns::new(scan);
        let prototype = columns
            .0
            .iter()
            .map(|column| Record {
                name: column.name.clone(),
                data_type: column.data_type.clone(),
            })
            .collect();
        let mut cloud = self.inner.add_pointcloud(scan.guid, prototype)?;
        cloud.set_name(Some(cdata(scan.name)));
        cloud.set_transform(scan.pose.map(|pose| transform(&pose)));
        let count = scan.xyz.len();
        for index in 0..count {
            cloud.add_point(
                columns
                    .0
                    .iter()
                    .map(|column| column.value(scan, index))
                    .collect(),
            )?;
        }
        if scan
            .invalid
            .map_or(count == 0, |invalid| invalid.iter().all(|&i| i))
        {
            cloud.set_cartesian_bounds(None);
        }
        if count == 0 {
            cloud.set_index_bounds(None);
        }
        cloud.finalize()
    }

    /// Appends a picture.
    pub fn add_photo(&mut self, photo: &Photo) -> io::Result<()> {
        self.put_photo(photo).map_err(refusal)
    }

    fn put_photo(&mut self, photo: &Photo) -> e57::Result<()> {
        let mut image = self.inner.add_image(photo.guid)?;
        image.set_name(&cdata(photo.name));
        image.set_pointcloud_guid(photo.scan_guid);
        if let Some(pose) = &photo.pose {
            image.set_transform(transform(pose));
        }
        let format = if photo.png {
            ImageFormat::Png
        } else {
            ImageFormat::Jpeg
        };
        let (width, height) = (photo.width, photo.height);
        let mut data = Cursor::new(photo.data);
        match photo.model {
            PhotoModel::VisualReference => image.add_visual_reference(
                format,
                &mut data,
                VisualReferenceImageProperties { width, height },
                None,
            )?,
            PhotoModel::Pinhole {
                focal,
                pixel,
                principal,
            } => image.add_pinhole(
                format,
                &mut data,
                PinholeImageProperties {
                    width,
                    height,
                    focal_length: focal,
                    pixel_width: pixel[0],
                    pixel_height: pixel[1],
                    principal_x: principal[0],
                    principal_y: principal[1],
                },
                None,
            )?,
            PhotoModel::Spherical { pixel } => image.add_spherical(
                format,
                &mut data,
                SphericalImageProperties {
                    width,
                    height,
                    pixel_width: pixel[0],
                    pixel_height: pixel[1],
                },
                None,
            )?,
            PhotoModel::Cylindrical {
                radius,
                pixel,
                principal_y,
            } => image.add_cylindrical(
                format,
                &mut data,
                CylindricalImageProperties {
                    width,
                    height,
                    radius,
                    principal_y,
                    pixel_width: pixel[0],
                    pixel_height: pixel[1],
                },
                None,
            )?,
        }
        image.finalize()
    }

    /// Writes the XML section; without it the file is no E57 file.
    pub fn finish(mut self, guid: &str) -> io::Result<()> {
        let finished = self.inner.finalize_customized_xml(|xml| {
            // The crate 0.11 misspells the radius of cylindrical pictures.
            Ok(xml
                .replacen(NO_GUID, guid, 1)
                .replace("<readius type=\"Float\">", "<radius type=\"Float\">")
                .replace("</readius>", "</radius>"))
        });
        finished.map_err(refusal)
    }
}

/// The crate's errors wrap the operating system's; those come out as such, so that a full disk is named.
fn refusal(error: e57::Error) -> io::Error {
    let mut source = error.source();
    while let Some(inner) = source {
        let code = inner
            .downcast_ref::<io::Error>()
            .and_then(io::Error::raw_os_error);
        if let Some(code) = code {
            return io::Error::from_raw_os_error(code);
        }
        source = inner.source();
    }
    io::Error::other(error.to_string())
}

/// The crate writes strings as they are into CDATA, which cannot hold its own end or control characters.
pub(super) fn cdata(text: &str) -> String {
    text.chars()
        .map(|c| match c {
            '\t' | '\n' | '\r' => ' ',
            c if c.is_control() || matches!(c, '\u{fffe}' | '\u{ffff}') => '\u{fffd}',
            c => c,
        })
        .collect::<String>()
        .replace("]]>", "]]]]><![CDATA[>")
}

/// A pose as the standard has it: a unit quaternion with w not negative, and a translation.
pub(super) fn transform(pose: &Matrix) -> Transform {
    let rotation = Matrix3::from_fn(|row, column| pose[row][column]);
    let quaternion =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(rotation));
    // The standard wants the scalar part not negative.
    let sign = if quaternion.w < 0.0 { -1.0 } else { 1.0 };
    Transform {
        rotation: Quaternion {
            w: sign * quaternion.w,
            x: sign * quaternion.i,
            y: sign * quaternion.j,
            z: sign * quaternion.k,
        },
        translation: Translation {
            x: pose[0][3],
            y: pose[1][3],
            z: pose[2][3],
        },
    }
}
