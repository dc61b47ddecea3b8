use crate::sample::{reseal, sheet};
use chpm_format::{Chpm, FormatError, Page, dump, verify};
use chpm_mesh::{Attributes, ClusterId, GroupId};
use proptest::prelude::*;
use std::sync::LazyLock;

static GOOD: LazyLock<Vec<u8>> =
    LazyLock::new(|| sheet(8, 3, 4, Attributes { colors: true, ..Attributes::NONE }).bytes());

/// Offsets where something is: records, metadata, pages without their padding.
fn offsets() -> impl Strategy<Value = usize> {
    prop_oneof![0..496usize, 496..2400usize, (1..8usize, 0..600usize).prop_map(|(page, at)| 4096 * page + at)]
}

fn use_all(bytes: Vec<u8>) -> bool {
    let Ok(file) = Chpm::open(bytes) else { return false };
    for id in (0..file.clusters().len() as u32).map(ClusterId) {
        if let Ok(page) = file.page(id) {
            let page = page.view();
            let mut mesh = Vec::new();
            page.progressive_mesh().triangles_at(page.vertices_for(0.02), &mut mesh);
            assert!(page.shared().all(|(local, _)| page.is_shared(local)));
        }
    }
    for id in (0..file.groups().len() as u32).map(GroupId) {
        assert!(file.coarse(id).iter().chain(file.fine(id)).all(|c| (*c as usize) < file.clusters().len()));
    }
    verify(&file, |_, _| ());
    // A page that lies is an error at the end of the text.
    assert!(!matches!(dump(&file, &mut std::io::sink(), true), Err(FormatError::Write(_))));
    true
}

#[test]
fn the_sample_is_whole() {
    assert!(verify(&Chpm::open(GOOD.clone()).unwrap(), |_, _| ()).is_ok());
    assert!(use_all(GOOD.clone()));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn sealed_damage_never_panics(changes in prop::collection::vec((offsets(), any::<u8>()), 1..6)) {
        let mut bytes = GOOD.clone();
        for (offset, value) in changes {
            if let Some(byte) = bytes.get_mut(offset) {
                *byte = value;
            }
        }
        reseal(&mut bytes);
        use_all(bytes);
    }

    #[test]
    fn small_lies_never_panic(offset in offsets(), word in prop_oneof![0..9u32, Just(u32::MAX), 65_530..65_540u32]) {
        let mut bytes = GOOD.clone();
        let offset = offset & !3;
        bytes[offset..offset + 4].copy_from_slice(&word.to_le_bytes());
        reseal(&mut bytes);
        use_all(bytes);
    }

    #[test]
    fn pages_of_noise_never_panic(noise in prop::collection::vec(any::<u32>(), 0..80), keep in any::<bool>()) {
        let mut noise = noise;
        if keep && noise.len() >= 2 {
            noise[..2].copy_from_slice(bytemuck::cast_slice(&GOOD[4096..4104]));
        }
        prop_assert!(Page::parse(bytemuck::cast_slice(&noise)).is_err());
    }
}
