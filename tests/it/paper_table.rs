//! A paper's table of a dataset: LaTeX that compiles, and the same numbers as CSV.

use crate::sessions::{dataset, evrig, json, text};
use std::path::Path;
use std::process::Command;

const LIST: &str = "[[variant]]\nname = \"plain\"\nfrom = \"frames\"\npreset = \"DVS346\"\n\
    [[variant]]\nname = \"other_one\"\nfrom = \"frames\"\nmodel = \"esim\"\n";

/// Sets a document with the table where LaTeX is installed.
fn compile(table: &Path) {
    let document = format!(
        "\\documentclass{{article}}\\usepackage{{booktabs}}\\begin{{document}}\n\\input{{{}}}\n\
        \\end{{document}}\n",
        table.display()
    );
    let folder = table.parent().unwrap();
    std::fs::write(folder.join("document.tex"), document).unwrap();
    let run = Command::new("pdflatex")
        .args(["-halt-on-error", "-interaction=nonstopmode", "document.tex"])
        .current_dir(folder)
        .output();
    match run {
        Ok(output) => {
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stdout));
        }
        Err(_) => eprintln!("skipped: pdflatex is not installed"),
    }
}

#[test]
fn a_dataset_becomes_a_table_for_a_paper() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 3);
    let list = directory.path().join("list.toml");
    std::fs::write(&list, LIST).unwrap();
    // A folder that is not there yet.
    let tables = directory.path().join("tables");
    let out = tables.join("table.v1");
    let keys = "count_ratio,interval_ks,event_image_psnr";
    let arguments = ["--variants", text(&list), "--table", text(&out), "--each-session"];
    let (code, value, stderr) =
        json(evrig().arg("compare").arg(&root).args(arguments).args(["--measures", keys]));
    assert_eq!(code, 0, "{stderr}");

    let tex = tables.join("table.v1.tex");
    let latex = std::fs::read_to_string(&tex).unwrap();
    // Three sessions and their means, two variants each, and the heading.
    let rows: Vec<&str> = latex.lines().filter(|line| line.ends_with(r"\\")).collect();
    assert_eq!(rows.len(), 1 + 4 * 2, "{latex}");
    assert!(rows.iter().all(|row| row.matches(" & ").count() == 4), "{latex}");
    assert_eq!(latex.matches(r"\midrule").count(), 4);
    assert!(rows[0].contains(r"Event image PSNR [dB] $\uparrow$"), "{}", rows[0]);
    assert!(rows[1].starts_with(r"s0 & other\_one & $"), "{}", rows[1]);
    assert!(rows[7].starts_with("mean of 3 sessions & "), "{}", rows[7]);
    // One of each column and group at least: equal values are marked together.
    assert!((4 * 3..4 * 6).contains(&latex.matches(r"\mathbf").count()), "{latex}");
    compile(&tex);

    let mut reader = csv::Reader::from_path(tables.join("table.v1.csv")).unwrap();
    let head: Vec<String> = reader.headers().unwrap().iter().map(str::to_owned).collect();
    assert_eq!(head[..4], ["session", "variant", "count_ratio", "count_ratio_error"]);
    let records: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), 8);
    for (i, variant) in value["variants"].as_array().unwrap().iter().enumerate() {
        let record = &records[6 + i];
        assert_eq!(&record[1], variant["name"].as_str().unwrap());
        let mean = &variant["cells"][0]["mean"];
        assert_eq!(record[2].parse::<f64>().unwrap(), mean["value"].as_f64().unwrap());
        assert_eq!(record[3].parse::<f64>().unwrap(), mean["standard_error"].as_f64().unwrap());
    }
    let distance = |row: usize| records[row][2].parse::<f64>().unwrap().ln().abs();
    let best = if distance(6) < distance(7) { 6 } else { 7 };
    assert!(records[best][8].split(' ').any(|key| key == "count_ratio"), "{:?}", records[best]);
}

#[test]
fn a_session_becomes_a_table_and_an_unknown_measure_is_named() {
    let directory = tempfile::tempdir().unwrap();
    let root = dataset(directory.path(), 1);
    let session = root.join("s0");
    let (code, _, stderr) = json(evrig().args(["generate", text(&session)]));
    assert_eq!(code, 0, "{stderr}");
    let out = directory.path().join("one");
    let (code, _, stderr) = json(evrig().args(["compare", text(&session), "--table", text(&out)]));
    assert_eq!(code, 0, "{stderr}");
    let latex = std::fs::read_to_string(directory.path().join("one.tex")).unwrap();
    assert!(latex.contains("s0 & frames & $") && !latex.contains(r"\mathbf"), "{latex}");
    let wrong = ["compare", text(&session), "--table", text(&out), "--measures", "ssim"];
    let (code, _, stderr) = json(evrig().args(wrong));
    assert!(code == 2 && stderr.contains("no measure `ssim`"), "{code} {stderr}");
    assert!(stderr.contains("event_image_ssim"), "{stderr}");
}
