//! The header: compression, position of the data table, description of the streams.

use super::{Compression, PayloadKind, StreamHeader, StreamSpec, overflow};
use aedat::base::ioheader_generated::{self as generated, Ioheader, IoheaderArgs};
use evrig_core::geometry::Size;
use flatbuffers::FlatBufferBuilder;
use std::fmt::Write;

/// The first bytes of a file; a socket does not send them.
pub(super) const MAGIC: &[u8; 14] = b"#!AER-DAT4.0\r\n";

/// Longest header that is read: 16 MiB; real ones have some kilobytes.
pub(super) const MAX_HEADER_BYTES: usize = 1 << 24;

/// The position that means "no data table".
pub(super) const NO_TABLE: i64 = -1;

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) compression: Compression,
    /// Byte of the file at which the data table begins.
    pub(super) table_position: Option<u64>,
    pub(super) streams: Vec<StreamHeader>,
}

/// Parses the size-prefixed flatbuffer after the magic; the error describes what was found.
pub(super) fn parse(bytes: &[u8]) -> Result<Header, String> {
    if bytes.get(8..12) != Some(generated::IOHEADER_IDENTIFIER.as_bytes()) {
        return Err("bytes without the identifier IOHE".to_owned());
    }
    overflow::check(bytes, false)?;
    let table =
        generated::size_prefixed_root_as_ioheader(bytes).map_err(|error| one_line(&error))?;
    let code = table.compression();
    let compression = Compression::from_code(code)
        .ok_or_else(|| format!("unknown compression code {}", code.0))?;
    let table_position = u64::try_from(table.file_data_position()).ok();
    let xml = table.description().ok_or("no description of the streams")?;
    Ok(Header { compression, table_position, streams: parse_description(xml)? })
}

/// The first line of a flatbuffer error; its trace follows in further lines.
pub(super) fn one_line(error: &flatbuffers::InvalidFlatbuffer) -> String {
    let text = error.to_string();
    let first = text.lines().next().unwrap_or_default();
    format!("an invalid flatbuffer ({})", first.trim_end_matches('.'))
}

fn parse_description(xml: &str) -> Result<Vec<StreamHeader>, String> {
    let document = roxmltree::Document::parse(xml)
        .map_err(|error| format!("a description that is not XML ({error})"))?;
    let root = document.root_element();
    let outputs = child_node(root, "outInfo").ok_or("a description without the node outInfo")?;
    let mut streams: Vec<StreamHeader> = Vec::new();
    for node in outputs.children().filter(|node| node.has_tag_name("node")) {
        let stream = parse_stream(node)?;
        if streams.iter().any(|other| other.id == stream.id) {
            return Err(format!("stream {} described twice", stream.id));
        }
        streams.push(stream);
    }
    if streams.is_empty() { Err("a description without streams".to_owned()) } else { Ok(streams) }
}

fn parse_stream(node: roxmltree::Node<'_, '_>) -> Result<StreamHeader, String> {
    let name = node.attribute("name").unwrap_or_default();
    let id = name.parse().map_err(|_| format!("a stream numbered {name:?}"))?;
    let identifier = attribute(node, "typeIdentifier")
        .ok_or_else(|| format!("stream {id} without a typeIdentifier"))?;
    let info = child_node(node, "info");
    let from_info = |key| info.and_then(|info| attribute(info, key));
    let length = |key| from_info(key).and_then(|text| text.trim().parse::<u16>().ok());
    let size = match (length("sizeX"), length("sizeY")) {
        (Some(width), Some(height)) => Some(Size::new(width, height)),
        _ => None,
    };
    Ok(StreamHeader {
        id,
        name: attribute(node, "originalOutputName").unwrap_or_default().to_owned(),
        kind: PayloadKind::from_identifier(identifier),
        size,
        source: from_info("source").unwrap_or_default().to_owned(),
    })
}

fn child_node<'a, 'b>(
    parent: roxmltree::Node<'a, 'b>,
    name: &str,
) -> Option<roxmltree::Node<'a, 'b>> {
    parent.children().find(|node| node.has_tag_name("node") && node.attribute("name") == Some(name))
}

fn attribute<'a>(node: roxmltree::Node<'a, '_>, key: &str) -> Option<&'a str> {
    node.children()
        .find(|child| child.has_tag_name("attr") && child.attribute("key") == Some(key))
        .and_then(|child| child.text())
}

/// The size-prefixed flatbuffer of the header, whose length does not depend on the position.
pub(super) fn encode(
    compression: Compression,
    table_position: Option<u64>,
    streams: &[StreamSpec],
) -> Vec<u8> {
    let position = table_position.and_then(|position| i64::try_from(position).ok());
    let mut builder = FlatBufferBuilder::new();
    // Without this a position of -1 would be omitted, and could not be replaced later.
    builder.force_defaults(true);
    let description = builder.create_string(&describe(compression, streams));
    let arguments = IoheaderArgs {
        compression: compression.code(),
        file_data_position: position.unwrap_or(NO_TABLE),
        description: Some(description),
    };
    let root = Ioheader::create(&mut builder, &arguments);
    generated::finish_size_prefixed_ioheader_buffer(&mut builder, root);
    builder.finished_data().to_vec()
}

/// The XML that DV and dv-processing expect.
fn describe(compression: Compression, streams: &[StreamSpec]) -> String {
    let mut xml =
        String::from("<dv version=\"2.0\">\n    <node name=\"outInfo\" path=\"/outInfo/\">\n");
    for (id, stream) in streams.iter().enumerate() {
        describe_stream(&mut xml, compression, id, stream);
    }
    xml.push_str("    </node>\n</dv>\n");
    xml
}

fn describe_stream(xml: &mut String, compression: Compression, id: usize, stream: &StreamSpec) {
    let mut line = |indent: usize, text: String| {
        // Writing to a String cannot fail.
        let _ = writeln!(xml, "{:indent$}{text}", "");
    };
    let attr = |key: &str, kind: &str, value: &str| {
        format!("<attr key=\"{key}\" type=\"{kind}\">{}</attr>", escape(value))
    };
    line(8, format!("<node name=\"{id}\" path=\"/outInfo/{id}/\">"));
    line(12, attr("compression", "string", compression.name()));
    line(12, attr("originalModuleName", "string", "evrig"));
    line(12, attr("originalOutputName", "string", &stream.name));
    line(12, attr("typeDescription", "string", meaning(&stream.kind)));
    line(12, attr("typeIdentifier", "string", stream.kind.identifier()));
    line(12, format!("<node name=\"info\" path=\"/outInfo/{id}/info/\">"));
    if let Some(size) = stream.size {
        line(16, attr("sizeX", "int", &size.width.to_string()));
        line(16, attr("sizeY", "int", &size.height.to_string()));
    }
    line(16, attr("source", "string", &stream.source));
    line(12, "</node>".to_owned());
    line(8, "</node>".to_owned());
}

fn meaning(kind: &PayloadKind) -> &str {
    match kind {
        PayloadKind::Events => "Array of events (polarity ON/OFF).",
        PayloadKind::Frames => "Standard frame.",
        PayloadKind::Imu => "Inertial Measurement Unit data samples.",
        PayloadKind::Triggers => "External triggers and special signals.",
        PayloadKind::Other(_) => "Custom data.",
    }
}

/// Text as XML takes it; control characters, which XML 1.0 cannot hold, become spaces.
fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            c if c.is_control() => escaped.push(' '),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn specs() -> Vec<StreamSpec> {
        vec![
            StreamSpec::events(Size::DAVIS346, "DAVIS346_a<b>&\"c\""),
            StreamSpec::frames(Size::new(32, 24), "x"),
            StreamSpec::imu("x"),
            StreamSpec::triggers(""),
        ]
    }

    #[test]
    fn a_header_says_what_was_put_in() {
        let header = parse(&encode(Compression::Zstd, Some(77), &specs())).unwrap();
        assert_eq!(header.compression, Compression::Zstd);
        assert_eq!(header.table_position, Some(77));
        for (id, (stream, spec)) in header.streams.iter().zip(specs()).enumerate() {
            assert_eq!(stream.id as usize, id);
            assert_eq!(
                (&stream.name, &stream.kind, stream.size, &stream.source),
                (&spec.name, &spec.kind, spec.size, &spec.source)
            );
        }
    }

    #[test]
    fn the_length_does_not_depend_on_the_position() {
        let open = encode(Compression::Lz4, None, &specs());
        let closed = encode(Compression::Lz4, Some(u64::MAX >> 1), &specs());
        assert_eq!(open.len(), closed.len());
        assert_eq!(parse(&open).unwrap().table_position, None);
    }

    #[test]
    fn a_stream_described_twice_is_refused() {
        let stream = r#"<node name="0"><attr key="typeIdentifier">EVTS</attr></node>"#;
        let xml = format!(r#"<dv><node name="outInfo">{stream}{stream}</node></dv>"#);
        assert_eq!(parse_description(&xml).unwrap_err(), "stream 0 described twice");
    }

    #[test]
    fn a_kind_without_meaning_keeps_its_name() {
        let xml = r#"<dv><node name="outInfo"><node name="7"><attr key="typeIdentifier">POSE</attr></node></node></dv>"#;
        let streams = parse_description(xml).unwrap();
        assert_eq!(streams[0].kind, PayloadKind::Other("POSE".to_owned()));
        assert_eq!((streams[0].id, streams[0].size), (7, None));
    }

    proptest! {
        #[test]
        fn damage_to_a_header_is_an_error_or_a_header_but_never_a_panic(
            at in any::<prop::sample::Index>(), value in any::<u8>(), cut in any::<prop::sample::Index>(),
        ) {
            let mut bytes = encode(Compression::Lz4, Some(9), &specs());
            let n_bytes = bytes.len();
            bytes[at.index(n_bytes)] = value;
            bytes.truncate(cut.index(n_bytes) + 1);
            let _ = parse(&bytes);
        }
    }
}
