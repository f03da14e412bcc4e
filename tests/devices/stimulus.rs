//! The target on a screen as Chromium draws it: scale, tag detection, confirmation and pause.
//!
//! `EVRIG_CHROMIUM` names the browser (default `/usr/bin/chromium`); skipped without one.

use crate::devtools::Browser;
use base64::Engine;
use evrig::device::stimulus::{ImageList, Screen, Stimulus};
use evrig::record::recorder::Recorder;
use evrig::rig::Rig;
use serde_json::json;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(60);
const PX_PER_MM: f64 = 9.5;
const COLOURS: [[u8; 3]; 2] = [[200, 30, 40], [20, 90, 210]];

fn images(folder: &Path) -> ImageList {
    for (n, colour) in COLOURS.into_iter().enumerate() {
        let image = image::RgbImage::from_pixel(20, 20, image::Rgb(colour));
        image.save(folder.join(format!("{n}.png"))).unwrap();
    }
    std::fs::write(folder.join("list.csv"), "0.png,red\n1.png,blue\n").unwrap();
    ImageList::read(&folder.join("list.csv")).unwrap()
}

fn serve(folder: &Path, px_per_mm: Option<f64>) -> Stimulus {
    let rig = Rig::simulated().unwrap();
    let address = "127.0.0.1:0".parse().unwrap();
    Stimulus::serve(address, &rig.target, images(folder), px_per_mm).unwrap()
}

fn browser(folder: &Path, url: &str) -> Option<Browser> {
    let program = std::env::var("EVRIG_CHROMIUM").unwrap_or_else(|_| "/usr/bin/chromium".into());
    if !Path::new(&program).exists() {
        eprintln!("skipped: there is no {program}; set EVRIG_CHROMIUM");
        return None;
    }
    let mut browser = Browser::start(&program, &folder.join("profile"));
    let metrics = json!({"width": 900, "height": 700, "deviceScaleFactor": 1, "mobile": false});
    browser.call("Emulation.setDeviceMetricsOverride", metrics);
    browser.call("Page.navigate", json!({"url": url}));
    browser.wait_for("Page.loadEventFired");
    Some(browser)
}

fn screenshot(browser: &mut Browser) -> image::RgbImage {
    let shot = browser.call("Page.captureScreenshot", json!({"format": "png"}));
    let png =
        base64::engine::general_purpose::STANDARD.decode(shot["data"].as_str().unwrap()).unwrap();
    image::load_from_memory(&png).unwrap().to_rgb8()
}

/// Left, top, right and bottom of the selected pixels.
fn extent(shot: &image::RgbImage, selects: impl Fn([u8; 3]) -> bool) -> [f64; 4] {
    let mut extent = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    for (x, y, _) in shot.enumerate_pixels().filter(|(_, _, pixel)| selects(pixel.0)) {
        let [x, y] = [f64::from(x), f64::from(y)];
        extent =
            [extent[0].min(x), extent[1].min(y), extent[2].max(x + 1.0), extent[3].max(y + 1.0)];
    }
    extent
}

#[test]
fn target_image_and_tag_are_drawn_to_scale_and_confirmed() {
    let folder = tempfile::tempdir().unwrap();
    let stimulus = Arc::new(serve(folder.path(), Some(PX_PER_MM)));
    let Some(mut browser) = browser(folder.path(), &stimulus.url()) else { return };
    assert!(stimulus.wait_until_ready(PATIENCE));
    let next = Arc::new(AtomicUsize::new(0));
    let mut screen = Screen::new(Arc::clone(&stimulus), Arc::clone(&next));
    let target = Rig::simulated().unwrap().target;
    for (n, (label, colour)) in ["red", "blue"].into_iter().zip(COLOURS).enumerate() {
        next.store(n, Ordering::SeqCst);
        let description = screen.prepare().unwrap().description;
        assert_eq!((&description["label"], &description["index"]), (&json!(label), &json!(n)));
        assert_eq!(description["shown"]["px_per_mm"], PX_PER_MM);
        let shot = screenshot(&mut browser);
        let image = extent(&shot, |pixel| pixel == colour);
        let tag = extent(&shot, |pixel| pixel == [0; 3]);
        let near = |a: f64, mm: f64| assert!((a - mm * PX_PER_MM).abs() <= 1.0, "{a} px, {mm} mm");
        near(image[2] - image[0], target.picture_side.0);
        near(image[3] - image[1], target.picture_side.0);
        near(tag[2] - tag[0], target.tag_side.0);
        near(tag[3] - tag[1], target.tag_side.0);
        near(tag[0] - image[2], target.gap.0);
        assert_eq!(tag[3], image[3], "the bottoms are aligned");
        assert!(finds_tag(&shot), "the tag is found as tag36h11 number 0");
    }
    // A page that does not fit is an error.
    let metrics = json!({"width": 400, "height": 300, "deviceScaleFactor": 1, "mobile": false});
    browser.call("Emulation.setDeviceMetricsOverride", metrics);
    let message = screen.prepare().unwrap_err().to_string();
    assert!(message.contains("400 x 300 pixels"), "{message}");
}

fn finds_tag(shot: &image::RgbImage) -> bool {
    use apriltag::families::Tag36h11;
    use apriltag::{Detector, Family, Image};
    let grey = image::imageops::grayscale(shot);
    let (width, height) = (grey.width() as usize, grey.height() as usize);
    let mut image = Image::zeros_with_alignment(width, height, 96).unwrap();
    let stride = image.stride();
    let rows = grey.as_raw().chunks(width);
    for (row, bytes) in rows.zip(image.as_slice_mut().chunks_mut(stride)) {
        bytes[..width].copy_from_slice(row);
    }
    let family: Family = Tag36h11::default().into();
    let mut detector = Detector::builder().add_family_bits(family, 1).build().unwrap();
    let found = detector.detect(&image);
    found.len() == 1 && found[0].id() == 0 && found[0].hamming() == 0
}

#[test]
fn the_operator_calibrates_pauses_and_switches_images_by_keys() {
    let folder = tempfile::tempdir().unwrap();
    let stimulus = serve(folder.path(), None);
    let Some(mut browser) = browser(folder.path(), &stimulus.url()) else { return };
    browser.evaluate(
        "new Promise((go) => { const poll = () => news ? go() : setTimeout(poll, 5); poll(); })",
    );
    assert!(!stimulus.wait_until_ready(Duration::ZERO), "the page is not calibrated");
    let mut press = |key: &str| {
        for kind in ["keyDown", "keyUp"] {
            browser.call("Input.dispatchKeyEvent", json!({"type": kind, "key": key}));
        }
    };
    press("ArrowUp");
    press("Enter");
    assert!(stimulus.wait_until_ready(PATIENCE));
    let scale = stimulus.state().px_per_mm.unwrap();
    assert!((scale - 96.0 / 25.4 * 1.001).abs() < 1e-9, "{scale}");
    press(" ");
    while !stimulus.state().is_paused {
        std::thread::yield_now();
    }
    assert!(!stimulus.wait_until_ready(Duration::ZERO));
    press("ArrowRight");
    while stimulus.state().index != 1 {
        std::thread::yield_now();
    }
    // The page must have received the pause before the next key can end it.
    wait_in_browser(&mut browser, "news.state.is_paused && news.state.index === 1");
    for kind in ["keyDown", "keyUp"] {
        browser.call("Input.dispatchKeyEvent", json!({"type": kind, "key": " "}));
    }
    assert!(stimulus.wait_until_ready(PATIENCE));
}

fn wait_in_browser(browser: &mut Browser, what: &str) {
    browser.evaluate(&format!(
        "new Promise((go) => {{ const poll = () => {what} ? go() : setTimeout(poll, 5); poll(); }})"
    ));
}

fn ask(stimulus: &Stimulus, head: &str) -> String {
    let address = stimulus.url().replace("http://", "").replace('/', "");
    let mut socket = TcpStream::connect(&address).unwrap();
    socket.write_all(head.replace("{host}", &address).as_bytes()).unwrap();
    let mut answer = String::new();
    socket.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn requests_of_other_hosts_and_pages_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let stimulus = serve(folder.path(), Some(PX_PER_MM));
    let status = |head: &str| ask(&stimulus, head).split(' ').nth(1).unwrap().to_owned();
    assert_eq!(status("GET / HTTP/1.1\r\nHost: {host}\r\n\r\n"), "200");
    assert_eq!(status("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n"), "403");
    let post = "POST /pause HTTP/1.1\r\nHost: {host}\r\nContent-Length: 18\r\n";
    let body = "\r\n{\"is_paused\":true}";
    assert_eq!(status(&format!("{post}{body}")), "403");
    assert!(!stimulus.state().is_paused);
    assert_eq!(status(&format!("{post}X-Evrig: stimulus\r\n{body}")), "204");
    assert!(stimulus.state().is_paused);
    assert_eq!(status("GET /image/9 HTTP/1.1\r\nHost: {host}\r\n\r\n"), "404");
    assert_eq!(status("GET /image/../list.csv HTTP/1.1\r\nHost: {host}\r\n\r\n"), "404");
    let rig = Rig::simulated().unwrap();
    let open = "0.0.0.0:0".parse().unwrap();
    let refused = Stimulus::serve(open, &rig.target, images(folder.path()), None).unwrap_err();
    assert!(refused.to_string().contains("reached from outside"));
}

#[test]
fn an_image_that_no_page_shows_is_not_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let stimulus = serve(folder.path(), Some(PX_PER_MM));
    let message = stimulus.show(1, Duration::from_millis(1)).unwrap_err().to_string();
    assert!(message.contains("blue") && message.contains(&stimulus.url()), "{message}");
}
