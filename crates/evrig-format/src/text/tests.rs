//! Each separator, comment and cut is read as a person reads it.

use super::*;

fn table(text: &str) -> Result<StoredTable, TextTableError> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("t.txt");
    std::fs::write(&path, text).unwrap();
    read_table(&path)
}

#[test]
fn every_separator_gives_the_same_table() {
    let expected = table("t,x,y,p\n1,2,3,True\n10,20,30,False\n").unwrap();
    assert_eq!(expected.columns[3].1, Column::Int(vec![1, 0]));
    for text in [
        "t;x;y;p\r\n1;2;3;1\r\n10;20;30;0\r\n",
        "\u{feff}t\tx\ty\tp\n1\t2\t3\tON\n10\t20\t30\tOFF\n",
        "t x y p\n1 2  3 1\n 10 20 30 0",
        "\"t\",\"x\",\"y\",\"p\"\n\n1, 2, 3, 1\n10, 20, 30, 0\n",
    ] {
        assert_eq!(table(text).unwrap(), expected, "{text:?}");
    }
}

#[test]
fn commas_of_a_comment_do_not_decide_the_separator() {
    let found = table("#!events\n# time in s, x, y, polarity\n0.5 1 2 1\n1.5 1 2 0\n").unwrap();
    assert_eq!(found.columns[0].1, Column::Float(vec![0.5, 1.5]));
    assert_eq!(found.notes[1], "# time in s, x, y, polarity");
}

#[test]
fn decimal_commas_are_read_beside_semicolons() {
    let found = table("0,5;1;2;1\n1,5;1;2;0\n").unwrap();
    assert_eq!(found.columns[0].1, Column::Float(vec![0.5, 1.5]));
}

#[test]
fn the_size_in_a_first_line_is_a_note() {
    let found = table("240 180\n0.5 1 2 1\n").unwrap();
    assert_eq!((found.n_rows(), found.columns.len()), (1, 4));
    assert_eq!(found.notes, ["sensor size 240 x 180"]);
}

#[test]
fn a_cut_last_line_is_left_out_and_stated() {
    let found = table("1,2,3,1\n10,20,3").unwrap();
    assert_eq!(found.n_rows(), 1);
    assert!(found.damage.unwrap().contains("line 2"));
    let error = table("1,2,3,1\n10,20,3\n4,4,4,0\n").unwrap_err().to_string();
    assert!(error.contains("line 2: expected 4 numbers, found 3"), "{error}");
}

#[test]
fn a_cell_that_is_no_number_is_named_with_its_line() {
    let error = table("t,x,y,p\n1,2,3,1\n1,nan,3,1\n").unwrap_err().to_string();
    assert!(error.contains("line 3: expected numbers, found `nan`"), "{error}");
}

#[test]
fn a_zipped_text_is_read_and_up_to_its_cut() {
    use std::io::Write;
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("events.zip");
    let mut archive = zip::ZipWriter::new(File::create(&path).unwrap());
    archive.start_file("events.txt", zip::write::SimpleFileOptions::default()).unwrap();
    writeln!(archive, "346 260").unwrap();
    for i in 0..200_000 {
        writeln!(
            archive,
            "{}.{:06} {} {} {}",
            i / 1_000,
            i * 7 % 1_000_000,
            i * 13 % 346,
            i % 260,
            i & 1
        )
        .unwrap();
    }
    archive.finish().unwrap();
    let whole = read_zipped_table(&path).unwrap();
    assert_eq!((whole.n_rows(), whole.damage), (200_000, None));
    assert_eq!(whole.notes, ["sensor size 346 x 260"]);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cut = read_zipped_table(&path).unwrap();
    assert!(cut.damage.unwrap().contains("cut"));
    let n = cut.columns[1].1.len();
    assert!((50_000..150_000).contains(&n), "{n}");
    let expected: Vec<i64> = (0..n as i64).map(|i| i * 13 % 346).collect();
    assert_eq!(cut.columns[1].1, Column::Int(expected));
}

#[test]
fn decimals_are_the_nearest_numbers() {
    for text in [
        "-0.25",
        "0.000",
        "0.1",
        "123456789.012345",
        "1234567890.123456789",
        "1.7",
        "999999999999.999",
        ".5",
        "5.",
        "1461581614.93",
        "1700000000.123456",
        "9007199254.740992",
        "9007199254.740993",
        "0.98765432109876543",
    ] {
        let found = table(&format!("t,x\n{text},1\n")).unwrap();
        assert_eq!(found.columns[0].1, Column::Float(vec![text.parse().unwrap()]), "{text}");
    }
    assert!(table("t,x\n1,1\n.,1\n").is_err());
}
