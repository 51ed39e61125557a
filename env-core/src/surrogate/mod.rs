//! The surrogate: a graph network in Candle that answers presses like finely meshed finite elements.

mod adam;
mod corrector;
mod features;
mod graph;
mod layers;
mod loss;
mod ops;
mod parameters;
mod samples;
mod train;

pub use corrector::CorrectorConfig;
pub use train::{Epoch, Training};

/// Temporary probe.
pub fn probe(folder: &std::path::Path, training: Training, hold: &[&str]) -> crate::Result<()> {
    use crate::dataset::Dataset;
    let dataset = Dataset::open(folder)?;
    let gels = samples::Gels::new(dataset.config())?;
    let held = |grasp: &str| hold.iter().any(|h| grasp.starts_with(h));
    let start = std::time::Instant::now();
    let (train, lost) = gels.samples(&dataset, &|g| !held(g))?;
    let (test, lost_test) = gels.samples(&dataset, &|g| held(g))?;
    println!("{} + {} samples, {lost} + {lost_test} lost, {:.1} s", train.len(), test.len(), start.elapsed().as_secs_f64());
    let median = |all: &[[f32; 4]]| -> Vec<[f32; 2]> {
        (0..4).map(|i| { let mut v: Vec<f32> = all.iter().map(|e| e[i]).collect(); v.sort_by(f32::total_cmp); [v[v.len()/2], v[v.len()*19/20]] }).collect()
    };
    let mut trainer = train::Trainer::new(training)?;
    println!("start test {:.3?}", median(&train::judge(&trainer.network, &gels, &test)?));
    for _ in 0..trainer.training.epochs {
        let epoch = trainer.epoch(&gels, &train)?;
        print!("{} {} {:.3?} {:.1}s", epoch.epoch, epoch.steps, epoch.errors, epoch.seconds);
        if epoch.epoch % 4 == 0 { print!(" test {:.3?}", median(&train::judge(&trainer.network, &gels, &test)?)); }
        println!();
    }
    Ok(())
}
