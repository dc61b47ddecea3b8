//! `chpm bench`: figures that have to be there, and files that say the same.

use super::harness::Folder;

#[test]
fn figures_are_told_written_and_drawn() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 3000 -o in.ply -q");
    let words = "bench in.ply --runs 2 --samples 2 --csv out.csv --svg out.svg -q";
    let told = folder.stdout(words);
    let csv = String::from_utf8(folder.read("out.csv")).expect("text");
    let svg = String::from_utf8(folder.read("out.svg")).expect("text");
    let rows: Vec<Vec<&str>> = csv.lines().skip(1).map(|line| line.split(',').collect()).collect();
    let header: Vec<&str> = csv.lines().next().expect("a header").split(',').collect();
    let column = |name: &str| header.iter().position(|h| *h == name).expect("a column");
    let number = |row: &[&str], name: &str| row[column(name)].parse::<f64>().expect("a number");
    for name in [
        "chpm",
        "chpm-one-thread",
        "chpm-lock",
        "chpm-keep",
        "chpm-no-layout",
        "meshopt-clod",
        "meshopt-simplify",
        "kernel",
        "plain",
    ] {
        assert!(told.contains(name) && svg.contains(&format!("\n{name}\n")), "{name}: {told}");
        let of_name: Vec<_> = rows.iter().filter(|row| row[column("contender")] == name).collect();
        assert!(of_name.len() >= 4, "{name}: {csv}");
        let mut last = f64::INFINITY;
        for row in of_name {
            let (triangles, divisor) = (number(row, "triangles"), number(row, "divisor"));
            assert!(triangles <= last, "{name}: {csv}");
            last = triangles;
            // Whoever keeps locks or the topology may not get down to a 256th.
            assert!(divisor > 16.0 || triangles <= 3100.0 / divisor, "{name}: {csv}");
            assert!(number(row, "rms") > 0.0 && number(row, "rms") <= number(row, "max"), "{name}: {csv}");
            assert!(number(row, "wall_s") > 0.0 && number(row, "peak_rss_mb") > 1.0, "{name}: {csv}");
        }
    }
    assert!(
        told.contains("triangles by kernel's at equal rms") && told.contains("median of 2 runs"),
        "{told}"
    );
    // A fourth of a torus is nearer than a sixteenth.
    let kernel: Vec<_> = rows.iter().filter(|row| row[column("contender")] == "kernel").collect();
    assert!(number(kernel[0], "rms") < number(kernel[kernel.len() - 1], "rms"));
    assert_eq!(folder.names(), ["in.ply", "out.csv", "out.svg"]);
}

#[test]
fn those_who_are_asked_for_run_and_nobody_else() {
    let folder = Folder::new();
    folder.stdout("synth terrain --triangles 2000 -o in.ply -q");
    let told = folder.stdout("bench in.ply --runs 1 --samples 1 --only meshopt-clod,plain -q");
    assert!(told.contains("meshopt-clod") && told.contains("plain") && !told.contains("chpm-lock"), "{told}");
    for words in ["bench in.ply --only nobody", "bench in.ply --runs 0", "bench missing.ply", "bench in.chpm"]
    {
        assert!(folder.stderr(words, 2).contains("error"), "{words}");
    }
    folder.stdout("synth sphere --triangles 100 -o small.ply -q");
    assert!(folder.stderr("bench small.ply", 2).contains("fewer than 256 triangles"));
    assert!(!folder.stdout("--help").contains("contend"));
}

#[test]
fn numbers_of_threads_are_compared_with_one_another() {
    let folder = Folder::new();
    folder.stdout("synth torus --triangles 30k -o in.ply -q");
    let told = folder.stdout("bench in.ply --threads 1,2,3 --runs 2 -q --json");
    let told: serde_json::Value = serde_json::from_str(&told).expect("JSON");
    let builds = told["builds"].as_array().expect("builds");
    assert_eq!(builds.len(), 3);
    for (build, threads) in builds.iter().zip(1..) {
        assert_eq!(build["threads"], threads);
        let number = |name: &str| build[name].as_f64().expect("a number");
        let stages = build["stages"].as_array().expect("stages");
        let sum: f64 = stages.iter().map(|stage| stage["seconds"].as_f64().expect("seconds")).sum();
        assert!(stages.len() == 6 && sum > 0.0 && number("processor_seconds") > 0.0, "{build}");
        let speedup = builds[0]["seconds"].as_f64().expect("seconds") / number("seconds");
        assert!((number("speedup") - speedup).abs() < 1e-9, "{build}");
    }
    let told = folder.stdout("bench in.ply --threads 2 --runs 1 -q");
    assert!(told.contains("times as fast") && told.contains("simplify"), "{told}");
    assert_eq!(folder.names(), ["in.ply"]);
    for words in
        ["bench in.ply --threads 0", "bench in.ply --threads 1 --only plain", "bench none.ply --threads 1"]
    {
        assert!(folder.stderr(words, 2).contains("error"), "{words}");
    }
}
