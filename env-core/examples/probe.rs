fn main() {
    let args: Vec<String> = std::env::args().collect();
    let mut t = ruffini_core::surrogate::Training::default();
    t.epochs = args[2].parse().unwrap();
    t.network.width = args[3].parse().unwrap();
    rayon::ThreadPoolBuilder::new().num_threads(2).build_global().unwrap();
    let hold: Vec<&str> = args[4..].iter().map(String::as_str).collect();
    ruffini_core::surrogate::probe(std::path::Path::new(&args[1]), t, &hold).unwrap();
}
