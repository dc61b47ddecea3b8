//! A mesh of bounded error out of any source: `cargo run -p chpm-build --example build_and_select -- SCAN.ply`.
//!
//! The README shows the middle of it.

use std::error::Error;
use std::path::PathBuf;

use chpm_build::{BuildConfig, Cancel, Silent, build};
use chpm_extmem::MappedFile;
use chpm_format::Chpm;
use chpm_refine::{Cut, extract};

fn main() -> Result<(), Box<dyn Error>> {
    let scan = PathBuf::from(std::env::args_os().nth(1).ok_or("a mesh expected")?);

    let built = scan.with_extension("chpm");
    build(&scan, &built, &BuildConfig::default(), &Silent, &Cancel::default())?;

    let file = Chpm::open(MappedFile::open(&built)?)?; // reads the tables; pages when they are needed
    let cut = Cut::at_distance(&file, 0.1)?; // nothing of the source is farther from it, in its units
    let mesh = extract(&file, &cut)?; // positions and triangles of one mesh without cracks
    println!("{} triangles, within {}", mesh.triangles.len(), cut.distance(&file)?);

    Ok(())
}
