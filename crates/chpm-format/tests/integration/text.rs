use crate::sample::{sheet, tetrahedron, two_level};
use chpm_format::{Chpm, FilePart, Invariant, dump, verify};
use chpm_mesh::{Attributes, ClusterId};
use std::fmt::Write;
use std::path::Path;

fn text(bytes: Vec<u8>, pages: bool) -> String {
    let mut text = Vec::new();
    dump(&Chpm::open(bytes).unwrap(), &mut text, pages).unwrap();
    String::from_utf8(text).unwrap()
}

#[test]
fn a_tetrahedron_as_text() {
    insta::assert_snapshot!(text(tetrahedron().bytes(), true));
}

#[test]
fn two_levels_as_text() {
    insta::assert_snapshot!(text(two_level().bytes(), false));
}

#[test]
fn attributes_as_text() {
    let all = Attributes::ALL;
    let text = text(sheet(4, 2, 2, all).bytes(), true);
    let page: Vec<_> = text.lines().skip_while(|line| !line.starts_with("  page")).take(8).collect();
    insta::assert_snapshot!(page.join("\n"));
}

#[test]
fn unreadable_pages_are_told_and_do_not_stop_the_text() {
    let mut bytes = two_level().bytes();
    bytes[4096] = 0;
    let mut text = Vec::new();
    let error = dump(&Chpm::open(bytes).unwrap(), &mut text, true).unwrap_err();
    assert!(error.to_string().starts_with("page of cluster 0: checksum "), "{error}");
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains(&format!("  unreadable {error}")), "{text}");
    assert!(text.contains("cluster 2 level 0"));
}

#[test]
fn faults_name_invariant_and_place() {
    let mut bytes = two_level().bytes();
    bytes[8192 + 64] ^= 1;
    let fault = verify(&Chpm::open(bytes).unwrap(), |_, _| ()).faults.remove(0);
    assert_eq!((fault.invariant, fault.place), (Invariant::Bytes, FilePart::Page(ClusterId(1))));
    assert!(fault.to_string().starts_with("I10 bytes: page of cluster 1: page of cluster 1: checksum"));
}

/// Sixteen bytes a line, lines of zeros left out.
fn hex(bytes: &[u8]) -> String {
    let mut text = String::new();
    for (line, chunk) in bytes.chunks(16).enumerate() {
        if chunk.iter().all(|b| *b == 0) {
            if !text.ends_with("*\n") {
                text.push_str("*\n");
            }
            continue;
        }
        let digits: Vec<_> = chunk.iter().map(|b| format!("{b:02x}")).collect();
        let shown = |b: &u8| if b.is_ascii_graphic() || *b == b' ' { char::from(*b) } else { '.' };
        let ascii: String = chunk.iter().map(shown).collect();
        writeln!(text, "{:04x}  {:<47}  {ascii}", 16 * line, digits.join(" ")).unwrap();
    }
    writeln!(text, "{:04x}", bytes.len()).unwrap();
    text
}

#[test]
fn the_specimen_of_the_format_description_is_a_file() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("FORMAT.md");
    let description = std::fs::read_to_string(&path).unwrap();
    let (before, rest) = description.split_once("<!-- specimen -->\n").unwrap();
    let (block, after) = rest.split_once("<!-- end of specimen -->").unwrap();
    let fresh = format!("```text\n{}```\n", hex(&tetrahedron().bytes()));
    if std::env::var_os("BLESS").is_some() {
        std::fs::write(&path, format!("{before}<!-- specimen -->\n{fresh}<!-- end of specimen -->{after}"))
            .unwrap();
        return;
    }
    assert_eq!(block, fresh, "run this test with BLESS=1 to write it again");
}
