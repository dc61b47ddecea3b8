//! The command as a process, on generated meshes and, where they are at hand, on real ones.

mod integration {
    /// A fresh folder and the command in it.
    pub(crate) mod harness;

    /// Sources are read twice, by two readers, and what one lost is missed by the other.
    mod against;
    /// Tilesets as one file.
    mod archive;
    /// Images of meshes that are taken out of a file.
    mod atlases;
    /// Many models at once: what is built, what is not built again, what a failure leaves of the others.
    mod batch;
    /// Speed against error: figures, CSV and plot.
    mod bench;
    /// The same bytes on every system.
    mod bytes;
    /// Stored errors that are proven to hold, or refuted.
    mod certify;
    /// Files that are damaged, or truncated or changed while they are read.
    mod changing;
    /// Every verb, its exit codes, and that errors leave nothing behind.
    mod cli;
    /// Settings of presets and files.
    mod config;
    /// A server beyond its limits.
    #[cfg(feature = "web")]
    mod connections;
    /// Two models in a real window.
    #[cfg(feature = "viewer")]
    mod couple;
    /// Models in projected coordinates, put where these say on the earth.
    mod crs;
    /// Boundaries and topology as they are asked for, and random cuts that prove that nothing cracks.
    mod cuts;
    /// The same bytes for any number of threads and any memory.
    mod determinism;
    /// A file in one screen, and what a build says at its end.
    mod digest;
    /// The documents: their length, their links, and what they say to type.
    mod documents;
    /// Meshes that engines load.
    mod engines;
    /// The examples of the libraries run.
    mod examples;
    /// The same mesh in every format that is written, and simplified in one go.
    mod formats;
    /// A reader of GLB.
    pub(crate) mod glb;
    /// A reader of glTF in either container.
    pub(crate) mod gltf;
    /// Every mesh that is hard to simplify, and what its file must be; flat plates and absent attributes.
    mod hard_cases;
    /// Damaged .chpm files: each verb answers, none panics.
    mod hostile_chpm;
    /// Invalid PLY files are refused with their place, or dropped and counted.
    mod hostile_ply;
    /// The same mesh in every format that is read.
    mod inputs;
    /// What `--json` prints, held against the page that documents it.
    mod json;
    /// Positions on a lattice.
    mod lattice;
    /// Levels of detail in one file, or in several.
    mod lods;
    /// Known distances, and stored errors that hold or do not.
    mod measure;
    /// Verbs that read stay below the memory that they are given.
    mod memory;
    /// The hierarchy for mesh shaders, read by the document alone.
    mod meshlets;
    /// The reader in JavaScript and the page.
    #[cfg(feature = "web")]
    mod node;
    /// Surfaces that touch, coincide or overlap: no report of what the source has itself.
    mod odd_cuts;
    /// Odd sources, names and options: what is told of them, and what comes out.
    mod oddities;
    /// What is written, and where: devices, links, streams, names, limits.
    mod outputs;
    /// Releases: workflows, manifests of package managers.
    mod packaging;
    /// How near two models are, and what is refused.
    mod proximity;
    /// A file's bytes, read without the reader under test.
    mod raw;
    mod rays;
    /// Pages stored otherwise, and proof that they hold the same.
    mod relayout;
    /// Pictures, and camera paths in pictures.
    #[cfg(feature = "viewer")]
    mod render;
    /// A file as a page, and what a browser makes of it.
    mod report;
    /// A build that is killed at any moment goes on where it was.
    mod resume;
    /// What goes in comes out: all of it at level 0, a crack-free part of it elsewhere.
    mod roundtrip;
    /// Numbers that vertices have by name.
    mod scalars;
    /// Real meshes, where there are any.
    mod scans;
    /// Only what a scene needs: finest and coarsest errors, and what costs nothing.
    mod scene;
    mod section;
    /// Shadows of the GPU beside those of rays.
    #[cfg(feature = "viewer")]
    mod shadows;
    /// Images of clusters.
    mod sheets;
    /// A build that is told to stop leaves nothing.
    mod signals;
    /// Dust that is left out of what is built, and of what it is compared with.
    mod small;
    /// Dust above a surface: what it costs, and that what is said of it holds.
    mod specks;
    /// Builds in steps, on many machines.
    mod stage;
    /// How models stand, and what of them is framed.
    #[cfg(feature = "viewer")]
    mod stance;
    /// Statistics, found anew in the bytes of the file.
    mod stats;
    /// Pictures by rays: where light and shadow fall.
    #[cfg(feature = "viewer")]
    mod stills;
    /// The command line as people meet it.
    mod terminal;
    mod texels;
    mod texture;
    /// The house rules: which crate may use which, where unsafe code may be, how long a file gets.
    mod tidy;
    /// Models that lie in several files.
    mod tiled;
    /// Tilesets, walked as viewers do.
    mod tiles;
    /// `build --trace`: what each thread did when.
    mod trace;
    /// A source that has changed somewhere, built anew there alone.
    mod update;
    /// What a camera needs: extracted without cracks, and less where it is far away.
    mod view;
    /// Pages in files of their own: the model is the same, and what is not theirs is refused by name.
    mod volumes;
    /// Camera paths and walks along them.
    mod walk;
    /// A browser gets what it needs, and nothing else.
    #[cfg(feature = "web")]
    mod web;
    /// A real window, on a display without a screen.
    #[cfg(feature = "viewer")]
    mod window;
    /// Numbers as people type and read them, and what is said where a file gives less than was asked for.
    mod words;
    /// The workflow that spreads a batch over machines.
    mod workflow;
}
