//! The two cameras of a rig description.

use super::fields::{DescriptionFields, POSITIVE};
use evrig_core::delivery::{Coding, Focus, RgbDelivery};
use evrig_core::geometry::Size;
use evrig_core::keyword::UnknownKeyword;
use evrig_core::time::Span;
use evrig_core::units::{Hertz, Micrometres, Millimetres};
use evrig_format::aedat4::Compression;
use std::str::FromStr;

/// Connection of a camera.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CameraTransport {
    /// The simulated camera of this program.
    Sim,
    /// USB, the first camera of its kind.
    Usb,
    /// A server at `HOST:PORT`.
    Tcp(String),
    /// A server at `HOST:PORT`, encrypted, with mutual authentication.
    Tls(String),
    /// A recording that is replayed in real time.
    File(String),
}

/// Sensor, lens and light path: what both cameras have.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraDescription {
    /// Connection.
    pub transport: CameraTransport,
    /// Columns and rows.
    pub size: Size,
    /// From one pixel to the next.
    pub pixel_pitch: Micrometres,
    /// Of the lens.
    pub focal_length: Millimetres,
    /// Where the optical axis meets the sensor, in pixels; the middle unless stated.
    pub centre_px: [f64; 2],
    /// Brown's coefficients k1, k2, p1, p2, k3 in OpenCV's order.
    pub distortion: [f64; 5],
    /// From one row's exposure to the next row's; zero for a global shutter.
    pub row_time: Span,
    /// Exposure time of a row.
    pub exposure: Span,
    /// Frames per second.
    pub frame_rate: Hertz,
    /// Analogue gain.
    pub gain: f64,
    /// Black level of a frame, digital units.
    pub black_level_dn: f64,
    /// Standard deviation of the lens's blur where it was measured in focus, pixels.
    pub psf_sigma_px: Option<f64>,
    /// Read noise (standard deviation in the dark) of a frame, digital units, where it was
    /// measured.
    pub read_noise_dn: Option<f64>,
}

/// The event camera.
#[derive(Debug, Clone, PartialEq)]
pub struct DavisDescription {
    /// Sensor, lens and its frames.
    pub camera: CameraDescription,
    /// Whether it records frames too.
    pub aps: bool,
    /// Biases that differ from the driver's own, in its names and units (0..=2040).
    pub biases: Vec<(&'static str, u16)>,
    /// How `davis.aedat4` is compressed; not at all unless stated.
    pub compression: Compression,
}

/// The frame camera on the Raspberry Pi.
#[derive(Debug, Clone, PartialEq)]
pub struct PiDescription {
    /// Sensor and lens; the size is the crop that is recorded.
    pub camera: CameraDescription,
    /// Bits of a raw sample.
    pub raw_bits: u8,
    /// Whether raw Bayer frames are recorded.
    pub raw: bool,
    /// Whether RGB frames are recorded.
    pub rgb: bool,
    /// Focus control.
    pub focus: Focus,
    /// Coding of its frames in transmission.
    pub coding: Coding,
    /// When its RGB frames are transmitted.
    pub rgb_delivery: RgbDelivery,
    /// The directory with this machine's keys, for `tls://`; none for the user's own.
    pub keys: Option<String>,
    /// Column and row of the crop's first pixel in the sensor's mode, whose rows are read one after
    /// another from the SensorTimestamp on. Where it is not stated: the middle of the 1536 x 864
    /// mode.
    pub crop_origin_px: [i16; 2],
}

/// The Camera Module 3's fast mode (IMX708, 2 x 2 binned and cropped to 1536 x 864).
const SENSOR_MODE: Size = Size::new(1536, 864);

/// Column and row of the first pixel of a crop from the middle of the sensor's fast mode; the
/// beginning of a mode unknown for what is larger. Even, so that a mosaic keeps its order.
#[must_use]
pub fn middle_crop_origin_px(size: Size) -> [i16; 2] {
    let first = |mode: u16, crop: u16| {
        let margin = mode.checked_sub(crop).map_or(0, |margin| margin / 4 * 2);
        i16::try_from(margin).unwrap_or(i16::MAX)
    };
    [first(SENSOR_MODE.width, size.width), first(SENSOR_MODE.height, size.height)]
}

/// The DAVIS346's biases in the driver's names.
pub const DAVIS_BIASES: &[&str] = &[
    "localbufbn",
    "padfollbn",
    "diffbn",
    "onbn",
    "offbn",
    "pixinvbn",
    "prbp",
    "prsfbp",
    "refrbp",
    "readoutbufbp",
    "apsrosfbn",
    "adccompbp",
    "colsellowbn",
    "dacbufbp",
    "lcoltimeoutbn",
    "aepdbn",
    "aepuxbp",
    "aepuybp",
    "ifrefrbn",
    "ifthrbn",
    "biasbuffer",
];

impl FromStr for CameraTransport {
    type Err = UnknownKeyword;

    fn from_str(text: &str) -> Result<Self, UnknownKeyword> {
        let unknown =
            || UnknownKeyword::new(text, "sim, usb, tcp://HOST:PORT, tls://HOST:PORT or file:PATH");
        match text {
            "sim" => Ok(Self::Sim),
            "usb" => Ok(Self::Usb),
            _ => {
                let at = |scheme: &str| {
                    let address = text.strip_prefix(scheme)?;
                    let (host, port) = address.rsplit_once(':')?;
                    let is_whole = !host.is_empty() && port.parse::<u16>().is_ok();
                    is_whole.then(|| address.to_owned())
                };
                let path = text.strip_prefix("file:").filter(|path| !path.is_empty());
                at("tcp://")
                    .map(Self::Tcp)
                    .or_else(|| at("tls://").map(Self::Tls))
                    .or_else(|| path.map(|path| Self::File(path.to_owned())))
                    .ok_or_else(unknown)
            }
        }
    }
}

impl CameraDescription {
    /// Pixels per millimetre of a fronto-parallel plane at `distance`.
    #[must_use]
    pub fn pixels_per_mm(&self, distance: Millimetres) -> f64 {
        self.focal_length.0 / (self.pixel_pitch.0 * 1e-3 * distance.0)
    }

    /// Column and row at which a point (right, down, forward of the optical centre, mm) appears.
    ///
    /// The lens is taken as free of distortion. None for a point that is not ahead.
    #[must_use]
    pub fn pixel(&self, [right, down, forward]: [f64; 3]) -> Option<[f64; 2]> {
        let scale = self.focal_length.0 / (self.pixel_pitch.0 * 1e-3 * forward);
        (forward > 0.0)
            .then(|| [self.centre_px[0] + right * scale, self.centre_px[1] + down * scale])
    }

    /// Whether a column and row are on the sensor.
    #[must_use]
    pub fn sees(&self, pixel: Option<[f64; 2]>) -> bool {
        let [width, height] = [self.size.width, self.size.height].map(f64::from);
        pixel.is_some_and(|[x, y]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y))
    }

    fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let [width, height] = fields.numbers("size_px", 1.0..=8192.0);
        // What is missing is NaN and was reported.
        if width.fract().abs() > 0.0 || height.fract().abs() > 0.0 {
            fields.complain_about("size_px", "expected whole numbers of columns and rows");
        }
        let size = Size::new(width as u16, height as u16);
        let centre = fields.has("centre_px").then(|| fields.numbers("centre_px", 0.0..=8192.0));
        let us = |key, range: std::ops::RangeInclusive<f64>| {
            Span::from_secs_f64(fields.number(key, range) * 1e-6)
        };
        fields.require("transport");
        Self {
            transport: fields.parsed("transport").unwrap_or(CameraTransport::Sim),
            size,
            pixel_pitch: Micrometres(fields.number("pixel_pitch_um", 0.1..=100.0)),
            focal_length: Millimetres(fields.number("focal_length_mm", 0.1..=1000.0)),
            centre_px: centre.unwrap_or([width / 2.0, height / 2.0]),
            distortion: fields.numbers("distortion", -10.0..=10.0),
            row_time: us("row_time_us", 0.0..=1000.0),
            exposure: us("exposure_us", 1.0..=1e6),
            frame_rate: Hertz(fields.number("frame_rate_hz", 0.1..=1000.0)),
            gain: fields.number("gain", POSITIVE),
            black_level_dn: fields.number("black_level_dn", 0.0..=65535.0),
            psf_sigma_px: fields.optional_number("psf_sigma_px", 0.0..=20.0),
            read_noise_dn: fields.optional_number("read_noise_dn", 0.0..=1000.0),
        }
    }

    /// The exposure cannot exceed the frame period.
    fn check_exposure(&self, fields: &DescriptionFields<'_, '_>) {
        let period = Span::from_secs_f64(1.0 / self.frame_rate.0);
        if self.exposure > period {
            let what = format!("{} is longer than a frame's {period}", self.exposure);
            fields.complain_about("exposure_us", what);
        }
    }
}

impl DavisDescription {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let camera = CameraDescription::read(fields);
        camera.check_exposure(fields);
        let biases = fields
            .optional_table("biases", |biases| biases.named_integers(DAVIS_BIASES, 0.0..=2040.0));
        Self {
            camera,
            aps: fields.optional_bool("aps").unwrap_or(true),
            biases: biases.unwrap_or_default(),
            compression: fields.parsed("compression").unwrap_or(Compression::None),
        }
    }
}

impl PiDescription {
    pub(super) fn read(fields: &DescriptionFields<'_, '_>) -> Self {
        let camera = CameraDescription::read(fields);
        camera.check_exposure(fields);
        let crop_origin_px = if fields.has("crop_origin_px") {
            fields.numbers("crop_origin_px", 0.0..=8192.0).map(|px: f64| px as i16)
        } else {
            middle_crop_origin_px(camera.size)
        };
        Self {
            crop_origin_px,
            camera,
            raw_bits: fields.integer("raw_bits", 8.0..=16.0),
            raw: fields.optional_bool("raw").unwrap_or(true),
            rgb: fields.optional_bool("rgb").unwrap_or(true),
            focus: fields.parsed("focus").unwrap_or_default(),
            coding: fields.parsed("coding").unwrap_or_default(),
            rgb_delivery: fields.parsed("rgb_delivery").unwrap_or_default(),
            keys: fields.optional_text("keys"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_crop_comes_from_the_middle_of_the_mode_unless_it_is_larger() {
        assert_eq!(middle_crop_origin_px(Size::new(692, 520)), [422, 172]);
        assert_eq!(middle_crop_origin_px(Size::new(2304, 1296)), [0, 0]);
    }

    #[test]
    fn transports_are_distinguished() {
        assert_eq!("sim".parse(), Ok(CameraTransport::Sim));
        assert_eq!("tcp://pi:7777".parse(), Ok(CameraTransport::Tcp("pi:7777".into())));
        assert_eq!("file:a.aedat4".parse(), Ok(CameraTransport::File("a.aedat4".into())));
        assert_eq!("tls://pi:7766".parse(), Ok(CameraTransport::Tls("pi:7766".into())));
        for wrong in ["", "usb2", "tls://pi", "tcp://pi", "tcp://:1", "tcp://pi:99999", "file:"] {
            assert!(wrong.parse::<CameraTransport>().is_err(), "{wrong}");
        }
    }
}
