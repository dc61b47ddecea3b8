//! Damaged sources with images: read or refused, and never worse.

use super::textures::{FACE, INDICES, PNG, base, folder, glb, ply, read_with};
use chpm_import::Images;
use serde_json::json;
use std::fs;

/// Numbers that look random.
struct Draw(u64);

impl Draw {
    fn below(&mut self, limit: usize) -> usize {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as usize % limit.max(1)
    }

    /// Damages some bytes: other ones, copies of others, or fewer.
    fn spoil(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..=self.below(2) {
            let at = self.below(bytes.len());
            match self.below(5) {
                0 => bytes.truncate(at),
                1 => bytes[at] = self.below(256) as u8,
                2 => bytes[at] = b"0123456789-/. \n"[self.below(15)],
                3 => {
                    let len = self.below(40).min(bytes.len() - at);
                    let piece = bytes[at..at + len].to_vec();
                    let to = self.below(bytes.len());
                    bytes.splice(to..to, piece);
                }
                _ => {
                    let len = self.below(20).min(bytes.len() - at);
                    bytes.drain(at..at + len);
                }
            }
            if bytes.is_empty() {
                return;
            }
        }
    }
}

#[test]
fn damaged_textured_sources_are_read_or_refused() {
    let mtl = b"newmtl a\nKd 1 1 1\nmap_Kd -s 2 2 -o 1 1 1 -clamp on a.png\nnewmtl b\nmap_Kd w.<UDIM>.png\n";
    let obj = format!(
        "mtllib a.mtl \\\n b.mtl\n{FACE}usemtl a\nf 1/1 2/2 4/4 3/3\nusemtl b\nf 1/1 2/2 -1/-1\nf 1 2 3\n"
    );
    let face = format!("property list uchar float texcoord\nproperty int texnumber\n{INDICES}");
    let wedges =
        ply("comment TextureFile a.png\n", "", "0 0 0\n1 0 0\n1 1 0\n", &face, "6 0 0 1 0 0 1 0 3 0 1 2\n");
    let own = "property float s\nproperty float t\n";
    let vertices = ply(
        "comment TextureFile a.png\n",
        own,
        "0 0 0 0 0\n1 0 0 1 0\n1 1 0 1 1\n0 0 0 5 5\n",
        INDICES,
        "4 0 1 2 3\n",
    );
    let transform =
        json!({ "index": 0, "texCoord": 1, "extensions": { "KHR_texture_transform": { "rotation": 1 } } });
    let scene = glb(
        json!({ "materials": base(transform), "textures": [{ "source": 0 }], "images": [{ "bufferView": 2 }, { "uri": "a.png" }] }),
    );
    let rounds = std::env::var("CHPM_ROUNDS").map_or(150, |rounds| rounds.parse().unwrap());

    let mut draw = Draw(7);
    let dir = folder(&[("a.png", PNG), ("w.1001.png", PNG), ("b.mtl", b"newmtl a\n")]);
    let (mut read, mut refused) = (0, 0);
    for round in 0..rounds {
        let sources =
            [("a.obj", obj.as_bytes()), ("a.ply", &wedges), ("b.ply", &vertices), ("a.glb", &scene)];
        for (name, source) in sources {
            let (mut library, mut bytes) = (mtl.to_vec(), source.to_vec());
            let spoiled = if name == "a.obj" && round % 2 == 0 { &mut library } else { &mut bytes };
            draw.spoil(spoiled);
            fs::write(dir.path().join("a.mtl"), library).unwrap();
            fs::write(dir.path().join(name), bytes).unwrap();
            let images = [Images::IfAny, Images::Grey, Images::Required][round % 3];
            match read_with(&dir.path().join(name), images, 1 << 16) {
                Ok(found) => {
                    let materials = found.info.textures.map_or(0, |textures| textures.materials.len());
                    for triangle in found.textured {
                        assert!((triangle.material as usize) < materials, "{name}, round {round}");
                        assert!(
                            triangle.vertices.iter().all(|v| (*v as usize) < found.positions),
                            "{name}, round {round}"
                        );
                    }
                    read += 1;
                }
                Err(_) => refused += 1,
            }
        }
    }
    assert!(read > rounds / 2 && refused > rounds / 4, "{read} {refused}");
}
