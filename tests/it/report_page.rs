//! The report page in a browser: desktop and phone, light and dark.
//!
//! `EVRIG_CHROMIUM` names the browser; `EVRIG_SCREENSHOTS` a folder for the screenshots.

use crate::synthetic;

use crate::devtools::Browser;
use base64::Engine;
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::path::PathBuf;

const HOSTILE: &str = "street <script>document.title='broken'</script> \"&\" 'x'";

/// Measures the rendered page.
const PROBE: &str = r#"(() => {
  const visible = [...document.querySelectorAll(".drawing svg, .m-strip svg")]
    .filter((svg) => !svg.parentElement.closest("svg") && svg.checkVisibility());
  const overflowing = [...document.querySelectorAll("body *")].filter((e) => {
    const box = e.getBoundingClientRect();
    return !e.closest(".scroll, svg, thead") && box.width > 0 && (box.right > innerWidth + 0.5 || box.left < -0.5);
  });
  const text = [...document.querySelectorAll("svg text")].filter((t) => t.checkVisibility());
  const cut = text.filter((t) => {
    const box = t.getBoundingClientRect();
    const sheet = t.farthestViewportElement.getBoundingClientRect();
    return box.left < sheet.left - 1 || box.right > sheet.right + 1 || box.bottom > sheet.bottom + 1;
  });
  return {
    title: document.title,
    heading: document.querySelector("h1").textContent,
    scrollWidth: document.documentElement.scrollWidth,
    innerWidth,
    height: document.documentElement.scrollHeight,
    overflowing: overflowing.map((e) => e.tagName + "." + e.className),
    cut: cut.map((t) => t.textContent),
    sizes: visible.map((svg) => { const b = svg.getBoundingClientRect(); return [b.width, b.height]; }),
    smallestText: Math.min(...text.map((t) => t.getBoundingClientRect().height)),
    figures: document.querySelectorAll("figure").length,
    background: getComputedStyle(document.body).backgroundColor,
    scripts: document.scripts.length,
    sortButtons: document.querySelectorAll(".sortable th button").length,
  };
})()"#;

struct PageShot {
    name: String,
    probe: Value,
    png: Vec<u8>,
}

fn render(browser: &mut Browser, url: &str, width: u32, theme: &str) -> PageShot {
    let is_phone = width < 600;
    browser.call(
        "Emulation.setEmulatedMedia",
        json!({"media": "screen", "features": [{"name": "prefers-color-scheme", "value": theme}]}),
    );
    let metrics = |height: u64| json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": is_phone});
    browser.call("Emulation.setDeviceMetricsOverride", metrics(900));
    browser.call("Page.navigate", json!({"url": url}));
    browser.wait_for("Page.loadEventFired");
    let probe = browser.evaluate(PROBE);
    let height = probe["height"].as_u64().expect("a height").min(16_000);
    browser.call("Emulation.setDeviceMetricsOverride", metrics(height));
    let shot = browser.call("Page.captureScreenshot", json!({"format": "png"}));
    let png = base64::engine::general_purpose::STANDARD
        .decode(shot["data"].as_str().expect("a screenshot"))
        .expect("base64");
    let name = format!("{width}-{theme}.png");
    if let Some(folder) = std::env::var_os("EVRIG_SCREENSHOTS") {
        std::fs::write(PathBuf::from(folder).join(&name), &png).expect("the screenshot is kept");
    }
    PageShot { name, probe, png }
}

fn page_errors(events: &[Value]) -> Vec<&Value> {
    let is_bad = |event: &&Value| match event["method"].as_str() {
        Some("Runtime.exceptionThrown") => true,
        Some("Runtime.consoleAPICalled") => event["params"]["type"] == "error",
        Some("Log.entryAdded") => event["params"]["entry"]["level"] == "error",
        _ => false,
    };
    events.iter().filter(is_bad).collect()
}

fn check(shot: &PageShot) {
    let (name, probe) = (&shot.name, &shot.probe);
    assert_eq!(probe["heading"], HOSTILE, "{name}: the title is escaped");
    assert!(probe["title"].as_str().unwrap().starts_with("street <script>"), "{name}: {probe}");
    assert_eq!(probe["scripts"], 1, "{name}: only the script of the page");
    assert!(
        probe["scrollWidth"].as_f64() <= probe["innerWidth"].as_f64(),
        "{name}: the page is wider than the window: {probe}"
    );
    assert_eq!(probe["overflowing"], json!([]), "{name}: elements overflow");
    assert_eq!(probe["cut"], json!([]), "{name}: labels are clipped");
    let sizes = probe["sizes"].as_array().unwrap();
    assert!(sizes.len() >= 15, "{name}: only {} drawings are visible", sizes.len());
    for size in sizes {
        assert!(size[0].as_f64() > Some(60.0) && size[1].as_f64() > Some(10.0), "{name}: {size}");
    }
    assert!(probe["smallestText"].as_f64() >= Some(9.0), "{name}: too small to read: {probe}");
    assert!(probe["sortButtons"].as_u64() >= Some(5), "{name}: the script did not run");

    let image = image::load_from_memory(&shot.png).expect("a PNG").to_rgb8();
    let colours: BTreeSet<[u8; 3]> = image.pixels().map(|p| p.0).collect();
    assert!(colours.len() > 500, "{name}: the screenshot is almost blank");
}

#[test]
fn the_page_renders_at_every_width_in_light_and_dark() {
    let Some(program) = std::env::var("EVRIG_CHROMIUM").ok().filter(|p| !p.is_empty()) else {
        eprintln!("skipped: set EVRIG_CHROMIUM to a Chromium to render the page");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let html = synthetic::page(HOSTILE).to_html().expect("a page");
    assert!(html.len() < 3_000_000, "{} bytes", html.len());
    let path = folder.path().join("report.html");
    std::fs::write(&path, &html).expect("the page is written");
    eprintln!("the page has {} bytes", html.len());
    let url = format!("file://{}", path.display());

    let mut browser = Browser::start(&program, &folder.path().join("profile"));
    let mut backgrounds = BTreeSet::new();
    for width in [1280, 390, 360] {
        let [light, dark] = ["light", "dark"].map(|theme| render(&mut browser, &url, width, theme));
        check(&light);
        check(&dark);
        assert_ne!(light.png, dark.png, "light and dark are equal at {width} px");
        for shot in [&light, &dark] {
            backgrounds.insert(shot.probe["background"].to_string());
        }
    }
    assert_eq!(backgrounds.len(), 2, "backgrounds of light and dark: {backgrounds:?}");
    check_sorting(&mut browser);
    check_pointer_readout(&mut browser);
    check_print_in_dark_theme(&mut browser, &url);
    check_page_without_script(&mut browser, &url);
    assert!(page_errors(&browser.events).is_empty(), "{:?}", page_errors(&browser.events));
    let external: Vec<&Value> = browser
        .events
        .iter()
        .filter(|event| event["method"] == "Network.requestWillBeSent")
        .map(|event| &event["params"]["request"]["url"])
        .filter(|address| !is_own(address.as_str().unwrap_or_default(), &url))
        .collect();
    assert!(external.is_empty(), "the page requests {external:?}");
}

fn is_own(address: &str, page: &str) -> bool {
    address == page || address.starts_with("data:") || address == "about:blank"
}

/// The fourth column holds values with errors, which must sort as numbers.
fn check_sorting(browser: &mut Browser) {
    let column = "[...document.querySelectorAll('.sortable tbody tr')].map(r => Number(r.cells[3].dataset.key))";
    let press = "document.querySelectorAll('.sortable th button')[3].click()";
    for (expected, ascending) in [("ascending", true), ("descending", false)] {
        browser.evaluate(press);
        let values: Vec<f64> = serde_json::from_value(browser.evaluate(column)).expect("numbers");
        assert!(values.len() > 5);
        let is_sorted =
            values.windows(2).all(|w| if ascending { w[0] <= w[1] } else { w[0] >= w[1] });
        assert!(is_sorted, "{expected}: {values:?}");
        let state = browser
            .evaluate("document.querySelectorAll('.sortable th')[3].getAttribute('aria-sort')");
        assert_eq!(state, expected);
    }
}

/// The middle of a chart whose time axis runs from 0 to 2 s is 1 s.
fn check_pointer_readout(browser: &mut Browser) {
    let find = "(() => { const pads = [...document.querySelectorAll('.pad')].filter((p) => p.checkVisibility() && p.dataset.x.startsWith('lin'));
        pads[0].scrollIntoView({block: 'center'}); const b = pads[0].getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()";
    let at = browser.evaluate(find);
    browser.call("Input.dispatchMouseEvent", json!({"type": "mouseMoved", "x": at[0], "y": at[1]}));
    let shown = browser.evaluate("document.querySelector('.read-out')?.textContent ?? ''");
    assert!(shown.as_str().unwrap_or_default().starts_with("x 1, y "), "{shown}");
    browser.call("Input.dispatchMouseEvent", json!({"type": "mouseMoved", "x": 1, "y": 1}));
    assert_eq!(browser.evaluate("document.querySelectorAll('.read-out').length"), 0);
}

fn check_print_in_dark_theme(browser: &mut Browser, url: &str) {
    browser.call("Page.navigate", json!({"url": url}));
    browser.wait_for("Page.loadEventFired");
    browser.call(
        "Emulation.setEmulatedMedia",
        json!({"media": "print", "features": [{"name": "prefers-color-scheme", "value": "dark"}]}),
    );
    let ground = browser.evaluate("getComputedStyle(document.body).backgroundColor");
    assert_eq!(ground, "rgb(255, 255, 255)");
    let real =
        browser.evaluate("getComputedStyle(document.documentElement).getPropertyValue('--real')");
    assert_eq!(real, "#14181d", "the ink is dark in print");
    let pdf = browser.call("Page.printToPDF", json!({"preferCSSPageSize": true}));
    let pdf = pdf["data"].as_str().expect("a PDF");
    if let Some(folder) = std::env::var_os("EVRIG_SCREENSHOTS") {
        let bytes = base64::engine::general_purpose::STANDARD.decode(pdf).expect("base64");
        std::fs::write(PathBuf::from(folder).join("print.pdf"), bytes).expect("the PDF is kept");
    }
    assert!(pdf.len() > 100_000, "images are printed too");
}

fn check_page_without_script(browser: &mut Browser, url: &str) {
    browser.call("Emulation.setScriptExecutionDisabled", json!({"value": true}));
    browser.call("Emulation.setEmulatedMedia", json!({"media": "screen", "features": []}));
    browser.call("Page.navigate", json!({"url": url}));
    browser.wait_for("Page.loadEventFired");
    let probe = browser.evaluate(PROBE);
    assert_eq!(probe["sortButtons"], 0, "the script did not run");
    assert!(probe["sizes"].as_array().map(Vec::len) >= Some(15));
    assert_eq!(browser.evaluate("document.querySelectorAll('.sortable tbody tr').length"), 9);
}

#[test]
fn a_broken_page_fails_the_probe() {
    // The probe detects a page that is too wide and throws.
    let Some(program) = std::env::var("EVRIG_CHROMIUM").ok().filter(|p| !p.is_empty()) else {
        eprintln!("skipped: set EVRIG_CHROMIUM to a Chromium to render the page");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("broken.html");
    let broken = "<h1>x</h1><div style='width:3000px'>wide</div><script>throw Error('no')</script>";
    std::fs::write(&path, broken).expect("the page is written");
    let mut browser = Browser::start(&program, &folder.path().join("profile"));
    let shot = render(&mut browser, &format!("file://{}", path.display()), 1280, "light");
    assert!(shot.probe["scrollWidth"].as_f64() > shot.probe["innerWidth"].as_f64());
    assert_ne!(shot.probe["overflowing"], json!([]));
    assert_eq!(page_errors(&browser.events).len(), 1);
}
