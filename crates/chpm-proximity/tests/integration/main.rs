//! Proximity against looking at every pair of triangles, and against another library.

mod brute;
mod distances;
mod exact;
mod following;
mod gauges;
mod hard;
mod loose;
mod scans;
mod site;
mod touching;
