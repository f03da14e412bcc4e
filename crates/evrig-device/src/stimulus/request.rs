//! The little of HTTP/1.1 that one page on this machine needs.

use tokio::io::{AsyncRead, AsyncReadExt};

/// A head longer than this is refused.
const MAX_HEAD: usize = 16 << 10;
/// A body longer than this is refused.
const MAX_BODY: usize = 4 << 10;

/// What was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Request {
    pub(super) method: String,
    /// The path with its query.
    pub(super) target: String,
    headers: Vec<(String, String)>,
    pub(super) body: Vec<u8>,
}

impl Request {
    /// A header's value.
    pub(super) fn header(&self, name: &str) -> Option<&str> {
        let found = self.headers.iter().find(|(known, _)| known.eq_ignore_ascii_case(name));
        found.map(|(_, value)| value.as_str())
    }
}

/// Reads one request; the status to answer with when it is none.
pub(super) async fn read(source: &mut (impl AsyncRead + Unpin)) -> Result<Request, u16> {
    let mut bytes = Vec::new();
    let end = loop {
        if let Some(end) = bytes.windows(4).position(|four| four == b"\r\n\r\n") {
            break end;
        }
        if bytes.len() >= MAX_HEAD {
            return Err(431);
        }
        let mut part = [0; 2048];
        match source.read(&mut part).await {
            Ok(n) if n > 0 => bytes.extend_from_slice(&part[..n]),
            _ => return Err(400),
        }
    };
    let mut body = bytes.split_off(end + 4);
    let head = std::str::from_utf8(&bytes).map_err(|_| 400_u16)?;
    let mut lines = head.split("\r\n").filter(|line| !line.is_empty());
    let mut words = lines.next().unwrap_or_default().split(' ');
    let (Some(method), Some(target), Some("HTTP/1.1" | "HTTP/1.0"), None) =
        (words.next(), words.next(), words.next(), words.next())
    else {
        return Err(400);
    };
    let header = |line: &str| {
        let (name, value) = line.split_once(':')?;
        Some((name.trim().to_owned(), value.trim().to_owned()))
    };
    let headers = lines.map(header).collect::<Option<Vec<_>>>().ok_or(400_u16)?;
    let (method, target) = (method.to_owned(), target.to_owned());
    let mut request = Request { method, target, headers, body: Vec::new() };
    let length = request.header("content-length").map_or(Ok(0), str::parse::<usize>);
    let length = length.map_err(|_| 400_u16)?;
    if length > MAX_BODY {
        return Err(413);
    }
    while body.len() < length {
        let mut part = [0; 2048];
        match source.read(&mut part).await {
            Ok(n) if n > 0 => body.extend_from_slice(&part[..n]),
            _ => return Err(400),
        }
    }
    body.truncate(length);
    request.body = body;
    Ok(request)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<Request, u16> {
        let runtime = tokio::runtime::Builder::new_current_thread().build().unwrap();
        runtime.block_on(read(&mut text.as_bytes()))
    }

    #[test]
    fn a_request_with_a_body_is_taken_apart() {
        let text = "POST /shown HTTP/1.1\r\nHost: x\r\ncontent-Length: 3\r\n\r\nabcd";
        let request = parse(text).unwrap();
        assert_eq!((request.method.as_str(), request.target.as_str()), ("POST", "/shown"));
        assert_eq!(request.header("Host"), Some("x"));
        assert_eq!(request.body, b"abc");
    }

    #[test]
    fn what_is_no_request_or_too_long_is_refused() {
        let long = format!("GET / HTTP/1.1\r\nX: {}\r\n\r\n", "x".repeat(MAX_HEAD + 2048));
        for (text, status) in [
            ("", 400),
            ("GET /\r\n\r\n", 400),
            ("GET / HTTP/1.1\r\nno colon\r\n\r\n", 400),
            ("POST / HTTP/1.1\r\nContent-Length: 9\r\n\r\nabc", 400),
            ("POST / HTTP/1.1\r\nContent-Length: -1\r\n\r\n", 400),
            ("POST / HTTP/1.1\r\nContent-Length: 999999\r\n\r\n", 413),
            (&long, 431),
        ] {
            assert_eq!(parse(text), Err(status), "{}", &text[..text.len().min(60)]);
        }
    }
}
