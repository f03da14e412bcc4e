//! Writes SVG; all markup from values is written here.

use std::fmt::Write;

/// An SVG under construction; lengths in user units, y downwards.
#[derive(Debug)]
pub struct Canvas {
    body: String,
    width: f64,
    height: f64,
    depth: usize,
}

/// Horizontal alignment of a text.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The text begins at the anchor.
    Start,
    /// The anchor is the text's middle.
    Middle,
    /// The text ends at the anchor.
    End,
}

/// A rectangle in user units.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Area {
    /// Left edge.
    pub x: f64,
    /// Upper edge.
    pub y: f64,
    /// Width.
    pub w: f64,
    /// Height.
    pub h: f64,
}

impl Area {
    /// Right edge.
    #[must_use]
    pub fn right(self) -> f64 {
        self.x + self.w
    }

    /// Lower edge.
    #[must_use]
    pub fn bottom(self) -> f64 {
        self.y + self.h
    }
}

/// Escapes text for XML.
#[must_use]
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c if c.is_control() => escaped.push('\u{fffd}'),
            c => escaped.push(c),
        }
    }
    escaped
}

/// A length with two decimals at most, without trailing zeros.
#[must_use]
pub fn length(value: f64) -> String {
    let rounded = (value * 100.0).round() / 100.0;
    // Adding zero turns -0 into 0.
    format!("{}", rounded + 0.0)
}

impl Canvas {
    /// An empty canvas.
    #[must_use]
    pub fn new(width: f64, height: f64) -> Self {
        Self { body: String::new(), width, height, depth: 0 }
    }

    // Writing to a string cannot fail.
    fn put(&mut self, arguments: std::fmt::Arguments<'_>) {
        let _ = self.body.write_fmt(arguments);
    }

    /// A straight line.
    pub fn line(&mut self, class: &str, [x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) {
        self.put(format_args!(
            "<path class=\"{}\" d=\"M{} {}L{} {}\"/>",
            escape(class),
            length(x1),
            length(y1),
            length(x2),
            length(y2)
        ));
    }

    /// A line through points; a point that is not finite breaks it.
    pub fn polyline(&mut self, class: &str, points: impl IntoIterator<Item = [f64; 2]>) {
        let data = path_data(points);
        if !data.is_empty() {
            self.put(format_args!("<path class=\"{}\" d=\"{data}\"/>", escape(class)));
        }
    }

    /// A closed outline through points; points that are not finite are left out.
    pub fn polygon(&mut self, class: &str, points: impl IntoIterator<Item = [f64; 2]>) {
        let data = path_data(points.into_iter().filter(|p| p.iter().all(|v| v.is_finite())));
        if !data.is_empty() {
            self.put(format_args!("<path class=\"{}\" d=\"{data}Z\"/>", escape(class)));
        }
    }

    /// Round dots in one element; their size is the class's stroke width.
    pub fn dots(&mut self, class: &str, points: impl IntoIterator<Item = [f64; 2]>) {
        let mut data = String::new();
        for [x, y] in points.into_iter().filter(|p| p.iter().all(|v| v.is_finite())) {
            let _ = write!(data, "M{:.1} {:.1}h0", x, y);
        }
        if !data.is_empty() {
            self.put(format_args!("<path class=\"{}\" d=\"{data}\"/>", escape(class)));
        }
    }

    /// A rectangle.
    pub fn rect(&mut self, class: &str, area: Area) {
        self.put(format_args!(
            "<rect class=\"{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            escape(class),
            length(area.x),
            length(area.y),
            length(area.w.max(0.0)),
            length(area.h.max(0.0))
        ));
    }

    /// A circle.
    pub fn circle(&mut self, class: &str, [x, y]: [f64; 2], radius: f64) {
        self.put(format_args!(
            "<circle class=\"{}\" cx=\"{}\" cy=\"{}\" r=\"{}\"/>",
            escape(class),
            length(x),
            length(y),
            length(radius)
        ));
    }

    /// Text on its baseline.
    pub fn text(&mut self, class: &str, [x, y]: [f64; 2], anchor: Anchor, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        self.put(format_args!(
            "<text class=\"{}\" x=\"{}\" y=\"{}\" text-anchor=\"{anchor}\">{}</text>",
            escape(class),
            length(x),
            length(y),
            escape(text)
        ));
    }

    /// An image given as a data URI, stretched to the area.
    pub fn image(&mut self, class: &str, area: Area, data_uri: &str) {
        self.put(format_args!(
            "<image class=\"{}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" \
             preserveAspectRatio=\"none\" href=\"{}\"/>",
            escape(class),
            length(area.x),
            length(area.y),
            length(area.w),
            length(area.h),
            escape(data_uri)
        ));
    }

    /// Stores the scales of the plotting area for the page's pointer read-out.
    pub fn read_out(&mut self, area: Area, x: &str, y: &str) {
        self.put(format_args!(
            "<rect class=\"pad\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" data-x=\"{}\" \
             data-y=\"{}\"/>",
            length(area.x),
            length(area.y),
            length(area.w),
            length(area.h),
            escape(x),
            escape(y)
        ));
    }

    /// Clips marks at the area's edges until [`Canvas::unclip`]; coordinates do not change.
    pub fn clip(&mut self, area: Area) {
        // A nested viewport clips without an id.
        self.put(format_args!(
            "<svg x=\"{0}\" y=\"{1}\" width=\"{2}\" height=\"{3}\" viewBox=\"{0} {1} {2} {3}\">",
            length(area.x),
            length(area.y),
            length(area.w),
            length(area.h)
        ));
        self.depth += 1;
    }

    /// Ends the innermost [`Canvas::clip`].
    pub fn unclip(&mut self) {
        if self.depth > 0 {
            self.depth -= 1;
            self.body.push_str("</svg>");
        }
    }

    /// The finished drawing, hidden from screen readers: the page has alternative text.
    #[must_use]
    pub fn finish(mut self) -> String {
        while self.depth > 0 {
            self.unclip();
        }
        format!(
            "<svg viewBox=\"0 0 {} {}\" aria-hidden=\"true\" focusable=\"false\">{}</svg>",
            length(self.width),
            length(self.height),
            self.body
        )
    }
}

impl Canvas {
    /// The finished drawing as a file of its own, with a style sheet inside.
    pub(super) fn finish_file(mut self, style: &str) -> String {
        while self.depth > 0 {
            self.unclip();
        }
        let [width, height] = [self.width, self.height].map(length);
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
             viewBox=\"0 0 {width} {height}\">\n<style>\n{style}</style>\n{}</svg>\n",
            self.body
        )
    }
}

fn path_data(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let mut data = String::new();
    let mut pen = 'M';
    for [x, y] in points {
        if x.is_finite() && y.is_finite() {
            let _ = write!(data, "{pen}{} {}", length(x), length(y));
            pen = 'L';
        } else {
            pen = 'M';
        }
    }
    data
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn markup_in_a_text_is_only_text() {
        let mut canvas = Canvas::new(10.0, 10.0);
        canvas.text("\"><x", [0.0, 0.0], Anchor::Start, "<script>alert('&')</script>\u{0}");
        let svg = canvas.finish();
        assert!(svg.contains("&lt;script&gt;alert(&#39;&amp;&#39;)&lt;/script&gt;\u{fffd}"));
        assert!(!svg.contains("<x") && !svg.contains("<script"));
    }

    #[test]
    fn a_missing_value_breaks_a_line_and_starts_it_again() {
        let mut canvas = Canvas::new(10.0, 10.0);
        canvas.polyline("l", [[0.0, 1.0], [1.0, 2.0], [2.0, f64::NAN], [3.0, 4.0]]);
        assert!(canvas.finish().contains("d=\"M0 1L1 2M3 4\""));
    }

    #[test]
    fn a_forgotten_clip_is_closed() {
        let mut canvas = Canvas::new(10.0, 10.0);
        canvas.clip(Area { x: 1.0, y: 1.0, w: 2.0, h: 2.0 });
        let svg = canvas.finish();
        assert_eq!(svg.matches("<svg").count(), svg.matches("</svg>").count());
    }

    #[test]
    fn lengths_are_short() {
        assert_eq!(length(1.0), "1");
        assert_eq!(length(-0.001), "0");
        assert_eq!(length(2.346), "2.35");
    }
}
