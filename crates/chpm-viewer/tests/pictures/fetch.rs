//! Pages come whole, checked, and within their budget, or with an error that says what is wrong.

use crate::models::Model;
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_mesh::{Bytes, ClusterId};
use chpm_synth::Shape;
use chpm_viewer::ViewerError;
use chpm_viewer::internals::{Arrival, Block, Fetch, PageData};
use std::fs::OpenOptions;
use std::os::unix::fs::FileExt;
use std::sync::Arc;

type File = Arc<Chpm<MappedFile>>;

fn model() -> (Model, File) {
    let model = Model::synth(Shape::Isosurface, 12_000, 256);
    let file = Arc::new(model.open());
    (model, file)
}

fn fetch(file: &File, threads: usize, budget: u64) -> Fetch {
    Fetch::new(Arc::clone(file), threads, Bytes(budget)).expect("readers")
}

fn all(file: &File) -> impl DoubleEndedIterator<Item = ClusterId> + use<> {
    (0..file.clusters().len() as u32).map(ClusterId)
}

fn len(file: &File, id: ClusterId) -> u64 {
    u64::from(file.clusters()[id.index()].page_len)
}

fn pages(arrivals: Vec<Arrival>) -> Vec<Arc<PageData>> {
    arrivals.into_iter().map(|(_, page)| page.expect("a sound page")).collect()
}

#[test]
fn every_page_arrives_as_it_is_in_the_file() {
    let (_model, file) = model();
    for threads in [1, 3] {
        let mut fetch = fetch(&file, threads, u64::MAX);
        assert!(fetch.try_arrived().is_empty() && fetch.wait_arrived().is_empty(), "nothing was asked for");
        for id in all(&file).rev() {
            fetch.request(id);
        }
        let pages = pages(fetch.wait_arrived());
        assert!(pages.iter().map(|page| page.cluster()).eq(all(&file)), "each once, in order");
        for page in &pages {
            let expected = file.page(page.cluster()).expect("a sound page");
            let (got, expected) = (page.page(), expected.view());
            assert_eq!((got.positions, got.triangles), (expected.positions, expected.triangles));
            assert_eq!((got.targets, got.error_codes), (expected.targets, expected.error_codes));
            assert_eq!(got.shared_bits, expected.shared_bits);
            assert_eq!(page.len_bytes(), len(&file, page.cluster()));
        }
        let total = Bytes(all(&file).map(|id| len(&file, id)).sum());
        assert_eq!((fetch.held(), fetch.peak(), fetch.pending()), (total, total, 0));
        drop(pages);
        assert_eq!(fetch.held(), Bytes(0));
    }
}

/// Blocks are what a page makes, whoever makes them, and those of readers are handed out once and within their room.
#[test]
fn readers_make_blocks_while_there_is_room() {
    let (_model, file) = model();
    let bytes = |page: &Arc<PageData>| page.block().bytes().len() as u64;
    let mut fetch = fetch(&file, 2, u64::MAX);
    let mut made = 0;
    for room in [0, 1 << 16, u64::MAX / 2] {
        fetch.make_blocks(Bytes(room));
        all(&file).for_each(|id| fetch.request(id));
        let pages = pages(fetch.wait_arrived());
        let waiting = fetch.blocks().0;
        assert!(waiting <= room && waiting >= made, "{waiting} of {room}");
        made = waiting;
        for page in &pages {
            assert_eq!(page.block().bytes(), Block::of_page(&page.page()).bytes());
        }
        assert_eq!(fetch.blocks(), Bytes(0), "all were taken");
        if room > 1 << 16 {
            assert_eq!(made, pages.iter().map(bytes).sum::<u64>(), "all were made");
        }
    }
    // What nobody takes goes with its page.
    all(&file).for_each(|id| fetch.request(id));
    drop(fetch.wait_arrived());
    assert_eq!((fetch.blocks(), fetch.held()), (Bytes(0), Bytes(0)));
}

#[test]
fn the_budget_holds_and_everything_comes_in_the_end() {
    let (_model, file) = model();
    let total: u64 = all(&file).map(|id| len(&file, id)).sum();
    let budget = total / 12;
    let mut fetch = fetch(&file, 2, budget);
    for id in all(&file) {
        fetch.request(id);
    }
    let (mut seen, mut kept) = (Vec::new(), Vec::new());
    for round in 0.. {
        let arrived = pages(fetch.wait_arrived());
        // All that there is room for came, and was not let go yet: nothing more can.
        if arrived.is_empty() {
            assert!(!kept.is_empty() || fetch.pending() == 0, "what was let go made room");
            if fetch.pending() == 0 {
                break;
            }
        }
        assert!(fetch.held().0 <= budget, "round {round}");
        seen.extend(arrived.iter().map(|page| page.cluster()));
        // Every second time all is let go; else it stays, and what comes is what still fits.
        kept.extend(arrived);
        if round % 2 == 1 {
            kept.clear();
        }
    }
    seen.sort_unstable();
    assert!(seen.into_iter().eq(all(&file)), "each once");
    assert!(fetch.peak().0 <= budget);
}

#[test]
fn roots_come_whatever_the_budget() {
    let (_model, file) = model();
    let mut fetch = fetch(&file, 1, 0);
    file.roots().for_each(|root| fetch.request(root));
    let roots = pages(fetch.wait_arrived());
    assert!(roots.iter().map(|page| page.cluster()).eq(file.roots()));
    let leaf = all(&file).find(|id| !file.clusters()[id.index()].is_root()).expect("more than roots");
    fetch.request(leaf);
    assert!(fetch.wait_arrived().is_empty() && fetch.pending() == 1, "there is no room");
    fetch.evict(leaf);
    assert_eq!(fetch.pending(), 0);
}

#[test]
fn what_is_taken_back_does_not_arrive() {
    let (_model, file) = model();
    let mut fetch = fetch(&file, 2, u64::MAX);
    for id in all(&file) {
        fetch.request_ahead(id);
    }
    // At whatever stage it is by now.
    for id in all(&file).filter(|id| id.0 % 3 != 0) {
        fetch.evict(id);
    }
    let pages = pages(fetch.wait_arrived());
    assert!(pages.iter().map(|page| page.cluster()).eq(all(&file).filter(|id| id.0 % 3 == 0)));
    let held = pages.iter().map(|page| page.len_bytes()).sum();
    assert_eq!(fetch.held(), Bytes(held), "what was taken back takes no memory");
    // And dropping it with requests in the queue and pages that nobody fetched does not hang.
    all(&file).for_each(|id| fetch.request(id));
}

#[test]
fn damage_names_the_cluster_and_the_file() {
    let (model, file) = model();
    let victim = ClusterId(file.clusters().len() as u32 / 2);
    let record = file.clusters()[victim.index()];
    let bytes = OpenOptions::new().write(true).open(model.path()).expect("the file");
    bytes.write_all_at(&[0xff; 4], record.page_offset + u64::from(record.page_len) / 2).expect("written");
    let mut fetch = fetch(&file, 2, u64::MAX);
    all(&file).for_each(|id| fetch.request(id));
    let (sound, damaged): (Vec<Arrival>, Vec<Arrival>) =
        fetch.wait_arrived().into_iter().partition(|(_, page)| page.is_ok());
    let [(id, Err(error))] = &damaged[..] else { panic!("one is damaged: {damaged:?}") };
    assert!(matches!(error, ViewerError::Page { .. }) && *id == victim, "{error}");
    let text = error.to_string();
    for told in ["model.chpm", &victim.to_string(), "checksum", "build it again"] {
        assert!(text.contains(told), "{text}");
    }
    let held = sound.iter().flat_map(|(_, page)| page).map(|page| page.len_bytes()).sum();
    assert_eq!(fetch.held(), Bytes(held), "a damaged page takes no memory");
}

/// The map would end the process with SIGBUS.
#[test]
fn a_file_that_is_cut_short_meanwhile_is_an_error() {
    let (model, file) = model();
    let first = file.clusters().iter().map(|c| c.page_offset).min().expect("pages");
    let mut fetch = fetch(&file, 2, u64::MAX);
    let (gone, there): (Vec<ClusterId>, Vec<ClusterId>) =
        all(&file).partition(|id| file.clusters()[id.index()].page_offset > first);
    // To a whole number of the system's pages behind the tables, which stay mapped.
    let end = (first + len(&file, there[0])).next_multiple_of(4096);
    let cut: Vec<ClusterId> = gone
        .into_iter()
        .filter(|id| file.clusters()[id.index()].page_offset + len(&file, *id) > end)
        .collect();
    let bytes = OpenOptions::new().write(true).open(model.path()).expect("the file");
    bytes.set_len(end).expect("cut short");
    there.iter().chain(&cut).for_each(|id| fetch.request(*id));
    for (id, page) in fetch.wait_arrived() {
        match page {
            Ok(_) => assert_eq!(id, there[0]),
            Err(error @ ViewerError::Read { .. }) => {
                let text = error.to_string();
                assert!(cut.contains(&id) && text.contains("model.chpm") && text.contains(&id.to_string()));
            }
            Err(error) => panic!("{error}"),
        }
    }
    assert_eq!((fetch.pending(), fetch.held()), (0, Bytes(0)));
}
