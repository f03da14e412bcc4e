//! What `process` did, in words and as values.

use serde_json::{Value, json};

/// What was run, what was left out and why.
#[derive(Debug, Default)]
pub(super) struct Steps {
    pub(super) stages: Vec<Value>,
    pub(super) left_out: Vec<Value>,
    pub(super) text: String,
    /// Stages that had their inputs and gave nothing, or gave it with losses.
    pub(super) n_lost: usize,
}

impl Steps {
    pub(super) fn did(&mut self, stage: &str, words: &str, result: &Value) {
        let words = words.replace('\n', "\n          ");
        self.text += &format!("{stage:<9} {words}\n");
        self.stages.push(json!({ "stage": stage, "result": result }));
    }

    pub(super) fn leave_out(&mut self, stage: &str, because: &str) {
        self.text += &format!("{stage:<9} left out: {because}\n");
        self.left_out.push(json!({ "stage": stage, "because": because }));
    }

    pub(super) fn append(&mut self, next: Self) {
        self.stages.extend(next.stages);
        self.left_out.extend(next.left_out);
        self.text += &next.text;
        self.n_lost += next.n_lost;
    }
}
