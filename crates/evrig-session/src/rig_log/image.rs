//! `foxglove.RawImage` as protobuf, and the description of it that a file must carry.

use evrig_core::geometry::Size;
use evrig_core::time::{Stamp, Unix};
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, FieldDescriptorProto, FileDescriptorProto, FileDescriptorSet, Timestamp,
};

/// An image in Foxglove's schema (foxglove-sdk, `schemas/proto/foxglove/RawImage.proto`).
#[derive(Clone, PartialEq, Message)]
pub(super) struct RawImage {
    #[prost(message, optional, tag = "1")]
    timestamp: Option<Timestamp>,
    #[prost(fixed32, tag = "2")]
    pub(super) width: u32,
    #[prost(fixed32, tag = "3")]
    pub(super) height: u32,
    #[prost(string, tag = "4")]
    pub(super) encoding: String,
    #[prost(fixed32, tag = "5")]
    pub(super) step: u32,
    #[prost(bytes = "vec", tag = "6")]
    pub(super) data: Vec<u8>,
    #[prost(string, tag = "7")]
    frame_id: String,
}

/// The message of an image of the Pi's camera without row padding.
pub(super) fn encode(at: Stamp<Unix>, size: Size, encoding: &str, data: Vec<u8>) -> Vec<u8> {
    encode_in("pi", at, size, encoding, data)
}

/// The message of an image in a frame of reference, without row padding.
pub fn encode_in(
    frame: &str,
    at: Stamp<Unix>,
    size: Size,
    encoding: &str,
    data: Vec<u8>,
) -> Vec<u8> {
    let (seconds, nanos) = seconds_nanos(at);
    let image = RawImage {
        timestamp: Some(Timestamp { seconds, nanos }),
        width: u32::from(size.width),
        height: u32::from(size.height),
        encoding: encoding.to_owned(),
        step: (data.len() / usize::from(size.height).max(1)) as u32,
        data,
        frame_id: frame.to_owned(),
    };
    image.encode_to_vec()
}

/// Whole seconds and the remaining nanoseconds.
pub(super) fn seconds_nanos(at: Stamp<Unix>) -> (i64, i32) {
    let ns = at.as_nanos();
    (ns.div_euclid(1_000_000_000), ns.rem_euclid(1_000_000_000) as i32)
}

/// The description of RawImage and of the Timestamp it uses, as MCAP wants it for protobuf.
pub fn schema() -> Vec<u8> {
    let field = |name: &str, number, kind: Type, type_name: Option<&str>| FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(kind as i32),
        type_name: type_name.map(str::to_owned),
        ..Default::default()
    };
    let file = |name: &str, package: &str, dependency: &[&str], message: DescriptorProto| {
        FileDescriptorProto {
            name: Some(name.to_owned()),
            package: Some(package.to_owned()),
            dependency: dependency.iter().map(|&name| name.to_owned()).collect(),
            message_type: vec![message],
            syntax: Some("proto3".to_owned()),
            ..Default::default()
        }
    };
    let message = |name: &str, field| DescriptorProto {
        name: Some(name.to_owned()),
        field,
        ..Default::default()
    };
    let timestamp = message(
        "Timestamp",
        vec![field("seconds", 1, Type::Int64, None), field("nanos", 2, Type::Int32, None)],
    );
    let image = message(
        "RawImage",
        vec![
            field("timestamp", 1, Type::Message, Some(".google.protobuf.Timestamp")),
            field("frame_id", 7, Type::String, None),
            field("width", 2, Type::Fixed32, None),
            field("height", 3, Type::Fixed32, None),
            field("encoding", 4, Type::String, None),
            field("step", 5, Type::Fixed32, None),
            field("data", 6, Type::Bytes, None),
        ],
    );
    const TIME: &str = "google/protobuf/timestamp.proto";
    let files = vec![
        file(TIME, "google.protobuf", &[], timestamp),
        file("foxglove/RawImage.proto", "foxglove", &[TIME], image),
    ];
    FileDescriptorSet { file: files }.encode_to_vec()
}

/// The samples of an image message; none when it is not one.
pub(crate) fn decode_image(bytes: &[u8]) -> Option<Vec<u8>> {
    decode(bytes).map(|image| image.data)
}

/// The image of a message; none when it is not one.
pub(super) fn decode(bytes: &[u8]) -> Option<RawImage> {
    RawImage::decode(bytes).ok()
}
