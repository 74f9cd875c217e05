//! The command line: commands, options, and what each option takes.

use std::{net::SocketAddr, path::PathBuf};

use clap::{
    Args, Parser, Subcommand, ValueEnum,
    builder::{PossibleValuesParser, TypedValueParser},
    value_parser,
};
use common::{
    job::{Frames, JobId, JobState, MAX_SAMPLES, check_resolution},
    method::{
        Adaptive, Aim, Bvh, Direct, Fresnel, LightPick, LightSampling, Only, Reuse, Roulette, Sampler, TriangleTest,
    },
};

use crate::{
    bench::BenchCommand, chart::ChartArgs, compare::CompareArgs, coverage::CoverageArgs, soak::SoakArgs,
    stability::StabilityArgs,
};

/// A render farm with its own path tracer.
#[derive(Debug, Parser)]
#[command(name = "tessera", version, propagate_version = true, max_term_width = 100)]
pub struct Cli {
    /// What is logged, e.g. `debug` or `worker=debug,info` [default: info for services, warn otherwise]
    #[arg(long, global = true, env = "RUST_LOG", value_name = "FILTER", help_heading = "Everywhere")]
    pub log: Option<String>,
    /// How log lines are written: for people, or as one JSON object an event
    #[arg(long, global = true, env = "TESSERA_LOG_FORMAT", default_value = "text", help_heading = "Everywhere")]
    pub log_format: LogFormat,
    /// File of settings [default: tessera/config.toml in the user's folder for such files]
    #[arg(long, global = true, env = "TESSERA_CONFIG", value_name = "FILE", help_heading = "Everywhere")]
    pub config: Option<PathBuf>,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// How log lines are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object an event: `timestamp`, `level`, `target`, `fields`, and the request or lease in `span`.
    Json,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Render a scene on this machine
    Render(RenderArgs),
    /// Run the service that hands out work and puts images together
    Coordinator(CoordinatorArgs),
    /// Render for a coordinator, with all cores unless told otherwise
    Worker(WorkerArgs),
    /// Send a scene to a farm
    Submit(SubmitArgs),
    /// List the jobs of a farm
    Jobs(JobsArgs),
    /// Show a job
    Job(JobArgs),
    /// Cancel a job
    Cancel(JobArgs),
    /// Hand out no more work of a job
    Pause(JobArgs),
    /// Go on with a paused job
    Resume(JobArgs),
    /// Let a finished job go on to a finer target; every sample is kept
    Continue(ContinueArgs),
    /// List the workers of a farm
    Workers(FarmArgs),
    /// Show what a scene needs, which methods serve it, and which is chosen
    Plan(PlanArgs),
    /// Check and convert scene files
    #[command(subcommand)]
    Scene(SceneCommand),
    /// Draw speed against accuracy: methods against each other on one scene
    Chart(ChartArgs),
    /// Measure how far an image is from a reference
    Compare(CompareArgs),
    /// Show each method at the place where it fails, the textbook form beside ours
    Stability(StabilityArgs),
    /// Render a great many samples of everything, and find those that are not finite or below 0
    Soak(SoakArgs),
    /// Measure how often error bars hold the truth, and what they cost
    Coverage(CoverageArgs),
    /// Measure how fast the parts are
    #[command(subcommand)]
    Bench(BenchCommand),
    /// Show the settings that hold, and where each is from
    Config(ConfigArgs),
    /// Print a script that completes commands in a shell
    Completions(CompletionsArgs),
}

/// Options of `config`.
#[derive(Debug, Args)]
pub struct ConfigArgs {
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// The shell
    pub shell: clap_complete::Shell,
}

/// Options of `plan`.
#[derive(Debug, Args)]
pub struct PlanArgs {
    /// A scene file, or a bare mesh file
    pub scene: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
    /// What would be rendered.
    #[command(flatten)]
    pub job: JobOptions,
}

/// What to do with a scene file.
#[derive(Debug, Subcommand)]
pub enum SceneCommand {
    /// Read a scene and all its files, and say what is wrong
    Check(SceneCheckArgs),
    /// Make a native scene file of a mesh file
    Convert(SceneConvertArgs),
    /// Print the JSON Schema of scene files
    Schema,
}

/// Options of `scene check`.
#[derive(Debug, Args)]
pub struct SceneCheckArgs {
    /// A scene file, or a bare mesh file
    pub scene: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `scene convert`.
#[derive(Debug, Args)]
pub struct SceneConvertArgs {
    /// A mesh file
    pub scene: PathBuf,
    /// The scene file to write, in the same folder
    pub out: PathBuf,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Options of `render`.
#[derive(Debug, Args)]
pub struct RenderArgs {
    /// A scene file, or a bare mesh file
    #[arg(required_unless_present = "resume")]
    pub scene: Option<PathBuf>,
    /// Go on with the render that was interrupted, from the files it kept
    #[arg(long, value_name = "DIR", conflicts_with_all = ["scene", "data", "pixel"])]
    pub resume: Option<PathBuf>,
    /// A folder for all images, or one image as FILE.png or FILE.exr
    #[arg(short, long, value_name = "OUT", required_unless_present = "pixel")]
    pub output: Option<PathBuf>,
    /// Instead of an image: one sample of this pixel again, alone, with its path printed
    #[arg(long, value_name = "X,Y", requires = "sample", help_heading = "Replay", value_parser = pixel)]
    pub pixel: Option<[u32; 2]>,
    /// With --pixel: number of the sample, from 0
    #[arg(long, value_name = "N", requires = "pixel", help_heading = "Replay")]
    pub sample: Option<u32>,
    /// Threads to render with [default: all cores]
    #[arg(long, value_name = "N", env = "TESSERA_THREADS", value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Keep the coordinator's files here, instead of in a temporary folder
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Print the report as JSON
    #[arg(long)]
    pub json: bool,
    /// What to render.
    #[command(flatten)]
    pub job: JobOptions,
}

/// Options of `submit`.
#[derive(Debug, Args)]
pub struct SubmitArgs {
    /// A scene file, or a bare mesh file
    pub scene: PathBuf,
    /// Follow the job to its end
    #[arg(long)]
    pub watch: bool,
    /// With --watch: a folder for all images, or one image as FILE.png or FILE.exr
    #[arg(short, long, value_name = "OUT", requires = "watch")]
    pub output: Option<PathBuf>,
    /// Name of the job [default: the scene's]
    #[arg(long)]
    pub name: Option<String>,
    /// 0 (last) to 100 (first)
    #[arg(long, default_value_t = 50, value_name = "N", value_parser = value_parser!(u8).range(0..=100))]
    pub priority: u8,
    /// A word to find the job by; may be given several times
    #[arg(long = "tag", value_name = "WORD")]
    pub tags: Vec<String>,
    /// What to render.
    #[command(flatten)]
    pub job: JobOptions,
    /// Where the farm is.
    #[command(flatten)]
    pub farm: FarmArgs,
}

/// Which farm, and how to print what it says.
#[derive(Debug, Args)]
pub struct FarmArgs {
    /// Where the coordinator is.
    #[command(flatten)]
    pub connect: ConnectArgs,
    /// Print JSON
    #[arg(long)]
    pub json: bool,
}

/// Where a coordinator is and who asks.
#[derive(Debug, Args)]
pub struct ConnectArgs {
    /// Address of the coordinator
    #[arg(long, env = "TESSERA_COORDINATOR", value_name = "URL", default_value = "http://127.0.0.1:7878")]
    pub coordinator: String,
    /// File that holds the farm's token [default: the variable TESSERA_TOKEN]
    #[arg(long, value_name = "FILE", env = "TESSERA_TOKEN_FILE")]
    pub token_file: Option<PathBuf>,
}

/// Options of `jobs`.
#[derive(Debug, Args)]
pub struct JobsArgs {
    /// Only jobs in this state
    #[arg(long, value_name = "STATE")]
    pub status: Option<JobState>,
    /// Most jobs to list
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = value_parser!(u32).range(1..=500))]
    pub limit: u32,
    /// Where the farm is.
    #[command(flatten)]
    pub farm: FarmArgs,
}

/// Options of the commands about one job.
#[derive(Debug, Args)]
pub struct JobArgs {
    /// The job, such as j17
    pub job: JobId,
    /// Where the farm is.
    #[command(flatten)]
    pub farm: FarmArgs,
}

/// Options of `continue`.
#[derive(Debug, Args)]
pub struct ContinueArgs {
    /// The job, such as j17
    pub job: JobId,
    /// Follow the job to its end
    #[arg(long)]
    pub watch: bool,
    /// With --watch: a folder for all images, or one image as FILE.png or FILE.exr
    #[arg(short, long, value_name = "OUT", requires = "watch")]
    pub output: Option<PathBuf>,
    /// The finer target.
    #[command(flatten)]
    pub target: TargetOptions,
    /// Where the farm is.
    #[command(flatten)]
    pub farm: FarmArgs,
}

/// Options of `coordinator`.
#[derive(Debug, Args)]
pub struct CoordinatorArgs {
    /// Address to listen on; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:7878", env = "TESSERA_LISTEN")]
    pub listen: SocketAddr,
    /// Folder of jobs, assets and images
    #[arg(long, value_name = "DIR", default_value = "tessera-data", env = "TESSERA_DATA")]
    pub data: PathBuf,
    /// File that holds the token every request must bring [default: the variable TESSERA_TOKEN]
    #[arg(long, value_name = "FILE", env = "TESSERA_TOKEN_FILE")]
    pub token_file: Option<PathBuf>,
    /// Listen on an address that others can reach without asking for a token
    #[arg(long)]
    pub insecure: bool,
}

/// Options of `worker`.
#[derive(Debug, Args)]
pub struct WorkerArgs {
    /// Where the coordinator is.
    #[command(flatten)]
    pub connect: ConnectArgs,
    /// Threads to render with [default: all cores]
    #[arg(long, value_name = "N", env = "TESSERA_THREADS", value_parser = value_parser!(u32).range(1..=4096))]
    pub threads: Option<u32>,
    /// Name of this machine, for people [default: its host name]
    #[arg(long, value_name = "NAME", env = "TESSERA_WORKER_NAME")]
    pub name: Option<String>,
    /// Folder to keep the files of scenes in, so that they are fetched once
    #[arg(long, value_name = "DIR", env = "TESSERA_CACHE")]
    pub cache: Option<PathBuf>,
}

/// How exact the picture must be.
#[derive(Debug, Default, Clone, PartialEq, Args)]
pub struct TargetOptions {
    /// Samples of every pixel; beside another target, the most a pixel gets
    #[arg(long, value_name = "N", help_heading = "Target", value_parser = samples(), conflicts_with = "max_samples")]
    pub samples: Option<u32>,
    /// Until each pixel's error is below this share of its value [default: what the scene asks, else 0.1]
    #[arg(long, value_name = "R", help_heading = "Target", allow_negative_numbers = true, value_parser = positive, conflicts_with = "time")]
    pub noise: Option<f64>,
    /// The best picture for this many processor seconds
    #[arg(long, value_name = "SECONDS", help_heading = "Target", allow_negative_numbers = true, value_parser = positive)]
    pub time: Option<f64>,
    /// Most samples of a pixel
    #[arg(long, value_name = "N", help_heading = "Target", value_parser = samples())]
    pub max_samples: Option<u32>,
}

/// What to render: shared by the commands that make jobs.
#[derive(Debug, Default, Clone, PartialEq, Args)]
pub struct JobOptions {
    /// How exact the picture must be.
    #[command(flatten)]
    pub target: TargetOptions,

    /// Width and height in pixels [default: the scene's]
    #[arg(long, value_name = "WxH", help_heading = "Image", value_parser = resolution)]
    pub resolution: Option<[u32; 2]>,
    /// Frames, such as 1-10, 1-10x2 or 1,4,7-9 [default: the scene's, else 1]
    #[arg(long, value_name = "LIST", help_heading = "Image")]
    pub frames: Option<Frames>,
    /// Render only this part of the frame
    #[arg(long, value_name = "X,Y,W,H", help_heading = "Image", value_parser = crop)]
    pub crop: Option<[u32; 4]>,
    /// Edge of a tile, pixels [default: 64]
    #[arg(long, value_name = "N", help_heading = "Image", value_parser = value_parser!(u32).range(8..=1024))]
    pub tile: Option<u32>,
    /// Another seed gives an independent picture [default: 0]
    #[arg(long, value_name = "N", help_heading = "Image")]
    pub seed: Option<u64>,

    /// Bounces of a path: 0 is emission only, 1 direct light [default: the scene's, else 16]
    #[arg(long, value_name = "N", help_heading = "Method", value_parser = value_parser!(u32).range(0..=10_000))]
    pub max_depth: Option<u32>,
    /// How direct light is estimated
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Direct::ALL))]
    pub direct: Option<Direct>,
    /// Which lights a hit samples
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(LightPick::ALL))]
    pub light_pick: Option<LightPick>,
    /// Samples a hit takes of each light it samples
    #[arg(long, value_name = "N", help_heading = "Method", value_parser = value_parser!(u32).range(1..=4096))]
    pub light_samples: Option<u32>,
    /// Ways a path goes on from its first surface that is no mirror: a power of two
    #[arg(long, value_name = "N", help_heading = "Method", value_parser = value_parser!(u32).range(1..=64))]
    pub splits: Option<u32>,
    /// What neighbouring pixels share of their paths
    #[arg(long, value_name = "WHAT", help_heading = "Method", value_parser = choice(Reuse::ALL))]
    pub reuse: Option<Reuse>,
    /// How points on area lights are chosen
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(LightSampling::ALL))]
    pub light_sampling: Option<LightSampling>,
    /// Whether directions are aimed at mirrors and smooth glass
    #[arg(long, value_name = "AT", help_heading = "Method", value_parser = choice(Aim::ALL))]
    pub aim: Option<Aim>,
    /// Render a part of the light alone
    #[arg(long, value_name = "PART", help_heading = "Method", value_parser = choice(Only::ALL))]
    pub only: Option<Only>,
    /// Fresnel reflectance
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Fresnel::ALL))]
    pub fresnel: Option<Fresnel>,
    /// Source of sample points
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Sampler::ALL))]
    pub sampler: Option<Sampler>,
    /// When paths end at random
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Roulette::ALL))]
    pub roulette: Option<Roulette>,
    /// Test of a ray against a triangle
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(TriangleTest::ALL))]
    pub triangle: Option<TriangleTest>,
    /// How the tree over the surfaces is split; the picture stays the same
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Bvh::ALL))]
    pub bvh: Option<Bvh>,
    /// Rule for the number of samples
    #[arg(long, value_name = "HOW", help_heading = "Method", value_parser = choice(Adaptive::ALL))]
    pub adaptive: Option<Adaptive>,
    /// Textbook rule: samples between two looks at the error
    #[arg(long, value_name = "N", help_heading = "Method", value_parser = value_parser!(u32).range(2..=65_536))]
    pub adaptive_batch: Option<u32>,
    /// Textbook rule: half-width of the 95% interval relative to the mean
    #[arg(long, value_name = "R", help_heading = "Method", allow_negative_numbers = true, value_parser = positive)]
    pub adaptive_tolerance: Option<f64>,
}

fn samples() -> clap::builder::RangedI64ValueParser<u32> {
    value_parser!(u32).range(1..=i64::from(MAX_SAMPLES))
}

/// One of a list of names, which help and errors show.
pub(crate) fn choice<T: Copy + Send + Sync>(all: &'static [(&'static str, T)]) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(all.iter().map(|(name, _)| *name)).try_map(move |text: String| {
        let found = all.iter().find(|(name, _)| *name == text);
        found.map(|(_, value)| *value).ok_or("not one of the names")
    })
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse() {
        Ok(value) if value > 0.0 && f64::is_finite(value) => Ok(value),
        _ => Err("expected a number above 0".into()),
    }
}

/// `WxH`, within what a frame may have.
fn resolution(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    let [w, h] = numbers.ok_or("expected width x height in pixels, such as 640x480")?;
    check_resolution("resolution", w, h).map_err(|error| error.message)?;
    Ok([w, h])
}

/// `X,Y`.
fn pixel(text: &str) -> Result<[u32; 2], String> {
    let numbers = text.split_once(',').and_then(|(x, y)| Some([x.trim().parse().ok()?, y.trim().parse().ok()?]));
    numbers.ok_or_else(|| "expected column,row counted from 0 at the top left, such as 100,50".into())
}

/// `X,Y,W,H`.
fn crop(text: &str) -> Result<[u32; 4], String> {
    let numbers: Option<Vec<u32>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let numbers = numbers.and_then(|numbers| <[u32; 4]>::try_from(numbers).ok());
    let [x, y, w, h] = numbers.ok_or("expected x,y,width,height in pixels, such as 100,50,64,64")?;
    if w == 0 || h == 0 { Err("the width and height must be above 0".into()) } else { Ok([x, y, w, h]) }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    fn render(options: &str) -> Result<JobOptions, String> {
        let line = format!("tessera render s.json -o out {options}");
        match Cli::try_parse_from(line.split_whitespace()) {
            Ok(Cli { command: Command::Render(args), .. }) => Ok(args.job),
            Ok(other) => panic!("{other:?}"),
            Err(error) => Err(error.to_string()),
        }
    }

    #[test]
    fn the_definition_is_sound() {
        Cli::command().debug_assert();
    }

    #[test]
    fn options_take_what_the_documentation_says() {
        let is = |options: &str, expected: JobOptions| assert_eq!(render(options), Ok(expected), "{options}");
        let none = JobOptions::default;
        let target = |target| JobOptions { target, ..JobOptions::default() };
        let any = TargetOptions::default;
        is("", none());
        is("--samples 64", target(TargetOptions { samples: Some(64), ..any() }));
        is(
            "--noise 0.05 --max-samples 512",
            target(TargetOptions { noise: Some(0.05), max_samples: Some(512), ..any() }),
        );
        is("--noise 0.05 --samples 512", target(TargetOptions { noise: Some(0.05), samples: Some(512), ..any() }));
        is("--time 30", target(TargetOptions { time: Some(30.0), ..any() }));
        is("--resolution 640x480", JobOptions { resolution: Some([640, 480]), ..none() });
        is("--frames 1-10x2", JobOptions { frames: "1,3,5,7,9".parse().ok(), ..none() });
        is("--crop 1,2,3,4", JobOptions { crop: Some([1, 2, 3, 4]), ..none() });
        is("--tile 32 --seed 7", JobOptions { tile: Some(32), seed: Some(7), ..none() });
        is("--max-depth 0", JobOptions { max_depth: Some(0), ..none() });
        is("--direct mis", JobOptions { direct: Some(Direct::Mis), ..none() });
        is("--light-pick tree", JobOptions { light_pick: Some(LightPick::Tree), ..none() });
        is("--light-samples 4", JobOptions { light_samples: Some(4), ..none() });
        let sampling = Some(LightSampling::SolidAngle);
        is("--light-sampling solid-angle", JobOptions { light_sampling: sampling, ..none() });
        is("--only indirect", JobOptions { only: Some(Only::Indirect), ..none() });
        is("--fresnel schlick", JobOptions { fresnel: Some(Fresnel::Schlick), ..none() });
        is("--sampler stratified", JobOptions { sampler: Some(Sampler::Stratified), ..none() });
        is("--roulette fixed", JobOptions { roulette: Some(Roulette::Fixed), ..none() });
        let textbook = Some(TriangleTest::MoellerTrumbore);
        is("--triangle moeller-trumbore", JobOptions { triangle: textbook, ..none() });
        is("--bvh midpoint", JobOptions { bvh: Some(Bvh::Midpoint), ..none() });
        is("--adaptive textbook", JobOptions { adaptive: Some(Adaptive::Textbook), ..none() });
        let textbook = JobOptions { adaptive_batch: Some(32), adaptive_tolerance: Some(0.05), ..none() };
        is("--adaptive-batch 32 --adaptive-tolerance 0.05", textbook);
    }

    #[test]
    fn every_wrong_value_is_refused_with_the_option_and_what_it_takes() {
        for (options, expected) in [
            ("--samples 0", "1..=16777216"),
            ("--samples many", "--samples"),
            ("--samples 4 --max-samples 8", "--max-samples"),
            ("--noise 0", "a number above 0"),
            ("--noise nan", "a number above 0"),
            ("--noise 0.1 --time 3", "--time"),
            ("--resolution 640", "such as 640x480"),
            ("--resolution 0x4", "0x4 is not within"),
            ("--resolution 100000x100000", "100000x100000 is not within 1x1 to 16384x16384"),
            ("--frames 9-1", "is not a list of frames"),
            ("--crop 1,2,3", "such as 100,50,64,64"),
            ("--crop 1,2,0,4", "above 0"),
            ("--tile 4", "8..=1024"),
            ("--direct best", "auto, bsdf, hemisphere, light, mis"),
            ("--light-pick none", "all, one, power, tree"),
            ("--light-samples 0", "1..=4096"),
            ("--light-sampling solid_angle", "area, stratified, solid-angle"),
            ("--only both", "direct, indirect"),
            ("--fresnel fast", "exact, schlick"),
            ("--sampler halton", "sobol, stratified, independent"),
            ("--roulette russian", "throughput, late, fixed, off"),
            ("--triangle woop", "watertight, moeller-trumbore"),
            ("--bvh none", "sah, mean-centroid, midpoint"),
            ("--adaptive yes", "off, textbook, on"),
            ("--adaptive-batch 1", "2..=65536"),
            ("--adaptive-tolerance -1", "--adaptive-tolerance"),
            ("--threads 0", "1..=4096"),
            ("--sample 1 --pixel 4", "such as 100,50"),
            ("--unheard-of", "--unheard-of"),
        ] {
            let error = render(options).expect_err(options);
            assert!(error.contains(expected), "{options}: {error}");
            let option = options.rsplit("--").next().unwrap_or_default().split(' ').next().unwrap_or_default();
            assert!(error.contains(option), "{options}: {error}");
        }
    }

    #[test]
    fn every_command_of_the_documentation_parses() {
        for line in [
            "render s.obj -o a.png --threads 2 --json --data d",
            "render s.json --pixel 3,4 --sample 5",
            "coordinator --listen 127.0.0.1:0 --data d",
            "coordinator --listen 0.0.0.0:7878 --data d --insecure --token-file t",
            "worker --coordinator http://h:1 --threads 4 --name n",
            "submit s.json --watch -o out --samples 4 --coordinator http://h:1",
            "jobs --json --status active --limit 3",
            "job j3",
            "cancel j3",
            "pause j3",
            "resume j3 --json",
            "continue j3 --noise 0.02 --watch -o out --json",
            "continue j3 --samples 256",
            "workers",
            "plan s.json --json --resolution 640x480 --light-pick one",
            "scene check s.json",
            "scene convert a.obj b.json",
            "scene schema",
            "chart s.json -o d --methods light+one,auto --budgets 4,16 --seeds 2 --threads 1 --json --resolution 8x8",
            "chart s.json -o d --reference a.exr --reference b.exr --max-depth 2 --seed 7",
            "compare a.exr b.exr --layer stderr.Y --json -o diff.png",
            "stability -o d --only roulette",
            "soak --samples 1e9 --scenes scenes --scenes a.json --only glass --threads 2 --keep d --json",
            "bench rays m.ply --runs 3 --threads 2 --brute-force --json --resolution 480x360",
            "coverage -o d --page p.md --trials 90 --quick --only simulated",
            "render --resume d -o out",
            "config --json --config c.toml",
            "completions zsh",
        ] {
            let words = ["tessera"].into_iter().chain(line.split(' '));
            assert!(Cli::try_parse_from(words).is_ok(), "{line}");
        }
        for line in [
            "render s.json",
            "render -o out",
            "render s.json --resume d -o out",
            "render s.json --pixel 1,2",
            "submit s.json -o out",
            "job 3",
            "plan",
            "",
        ] {
            let words = ["tessera"].into_iter().chain(line.split_whitespace());
            assert!(Cli::try_parse_from(words).is_err(), "{line}");
        }
    }
}
