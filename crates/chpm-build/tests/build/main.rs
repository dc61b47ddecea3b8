//! The pipeline as a whole: meshes go in as PLY files, and the files that come out are looked at from outside.

mod bytes;
mod chained;
mod groups;
mod lattice;
mod looks;
mod normals;
mod odd;
mod parts;
mod reading;
mod resume;
mod scalars;
mod scene;
mod shapes;
mod site;
mod small;
mod stop;
mod volumes;
