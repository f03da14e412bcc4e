//! `evrig prove`: concealed trials, from the plan to the score.

use super::{Ending, Output, WrongUse};
use crate::cli::ProveArgs;
use crate::diagnose::Options;
use crate::prove::{Bench, Family, Mix, draw, markdown};
use crate::time::Span;
use anyhow::Context;
use serde_json::json;

/// The shortest session that still sees every direction of a circle.
const QUICK_S: f64 = 2.6;
const FULL_S: f64 = 5.0;

pub(super) fn run(args: &ProveArgs, output: &Output) -> anyhow::Result<Ending> {
    let family = if args.recording.is_some() { Family::Plasmode } else { Family::World };
    let mix = mix(args, family);
    let seconds = args.seconds.unwrap_or(if args.quick { QUICK_S } else { FULL_S });
    if !(seconds.is_finite() && seconds > 0.0) {
        return Err(WrongUse(format!("--seconds {seconds}: expected more than 0")).into());
    }
    std::fs::create_dir_all(&args.out)
        .with_context(|| format!("cannot make {}", args.out.display()))?;
    let bench = Bench {
        out: args.out.clone(),
        duration: Span::from_secs_f64(seconds),
        recording: args.recording.clone(),
        options: Options { seed: args.seed, ..Options::brief() },
        is_tidy: !args.keep,
    };
    let trials = draw(mix, args.seed);
    let bar = output.progress("proving", trials.len() as u64);
    let proof = bench.run(family, &trials, &mut |what, done| {
        bar.set_position(done as u64);
        bar.set_message(what.to_owned());
        output.detail(what);
    })?;
    bar.finish_and_clear();
    let page = markdown(
        &format!("Family `{}`, seed {}", family.as_str(), args.seed),
        &proof.score,
        &proof.judgements,
    );
    let name = format!("proof-{}", family.as_str());
    for (suffix, text) in [("md", page.clone()), ("json", serde_json::to_string_pretty(&proof)?)] {
        let path = args.out.join(format!("{name}.{suffix}"));
        std::fs::write(&path, text).with_context(|| format!("cannot write {}", path.display()))?;
    }
    let value = json!({ "schema": "evrig.prove/1", "out": args.out, "mix": {
        "single": mix.single, "double": mix.double, "clean": mix.clean, "alien": mix.alien,
    }, "seconds": seconds, "seed": args.seed, "proof": proof });
    output.result(&value, page)?;
    Ok(Ending::Done)
}

/// How many trials of each kind: what is asked for, else a few or many.
fn mix(args: &ProveArgs, family: Family) -> Mix {
    let usual = match (args.quick, family) {
        (true, Family::Plasmode) => [3, 0, 0, 0],
        (true, _) => [3, 0, 1, 1],
        (false, Family::Plasmode) => [22, 0, 2, 0],
        (false, _) => [48, 12, 20, 9],
    };
    let any = [args.single, args.double, args.clean, args.alien];
    let is_asked = any.iter().any(Option::is_some);
    let count = |i: usize| any[i].unwrap_or(if is_asked { 0 } else { usual[i] });
    Mix { family, single: count(0), double: count(1), clean: count(2), alien: count(3) }
}
