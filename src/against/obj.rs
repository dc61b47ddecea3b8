//! Wavefront OBJ: `v` and `f` lines.

use super::mesh::Mesh;
use super::stream::{Stream, raw_words, real, text, words};
use anyhow::{Result, bail, ensure};
use std::collections::HashSet;

/// Reads an OBJ. Faces may name vertices that come later, so that no triangle is known before the end.
pub(super) fn read(mut stream: Stream, mesh: &mut Mesh<'_>) -> Result<()> {
    mesh.begin(true)?;
    let (mut line, mut next, mut corners) = (Vec::new(), Vec::new(), Vec::new());
    let mut invalid = HashSet::new();
    let mut vertices = 0i64;
    while stream.line(&mut line)? {
        while line.last() == Some(&b'\\') {
            line.pop();
            line.push(b' ');
            if !stream.line(&mut next)? {
                break;
            }
            line.append(&mut next);
        }

        let mut words = words(&line);
        match words.next() {
            Some("v") => {
                let mut position = [0.0; 3];
                for x in &mut position {
                    let word = words.next().unwrap_or("the end of the line");
                    let told = || format!("expected a number, got '{}'", word.escape_default());
                    *x = real(word, f64::NAN).ok_or_else(|| stream.wrong(told()))?;
                }
                if !position.iter().all(|x| x.is_finite()) {
                    ensure!(mesh.drops, stream.wrong("a coordinate that is not finite"));
                    mesh.counts.dropped_vertices += 1;
                    invalid.insert(vertices as u32);
                }
                mesh.vertex(position)?;
                vertices += 1;
            }
            Some("f") => {
                corners.clear();
                let mut is_valid = true;
                for word in raw_words(&line).skip(1) {
                    // What is behind the slash is of no concern here, text or not.
                    let digits = text(word.split(|byte| *byte == b'/').next().unwrap_or_default());
                    let number = digits.parse::<i64>();
                    let vertex = match number {
                        Ok(number) if number < 0 => vertices.saturating_add(number),
                        Ok(number) => number - 1,
                        Err(_) => bail!(stream.wrong(format!("no vertex: '{}'", word.escape_ascii()))),
                    };
                    let is_known = (0..vertices).contains(&vertex) && !invalid.contains(&(vertex as u32));
                    is_valid &= is_known || !mesh.drops;
                    let told = || format!("a corner is vertex {}", word.escape_ascii());
                    match u32::try_from(vertex) {
                        Ok(vertex) => corners.push(vertex),
                        Err(_) => ensure!(mesh.drops, stream.wrong(told())),
                    }
                }
                if is_valid {
                    mesh.face(&corners)?;
                } else {
                    mesh.counts.dropped_faces += 1;
                }
            }
            _ => {}
        }
    }
    mesh.end_of_vertices()
}
