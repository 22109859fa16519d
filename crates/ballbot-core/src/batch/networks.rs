//! Small networks from observations to actions, one for each robot or one for all, evaluated for eight robots at once.

use crate::task::ACTION_LEN;
use ballbot_base::error::{Error, Result, bounded};
use ballbot_base::lanes::{EIGHT, Eight, Kernel, Lane, Registers, Scalar, Wide, run_eight, tanh};
use ballbot_base::memory::try_zeros;

/// A layer of each of n networks: outputs = weights · inputs + biases.
#[derive(Clone, Copy, Debug)]
pub struct Layer<'a> {
    /// How many inputs the layer has.
    pub inputs: usize,
    /// How many outputs the layer has.
    pub outputs: usize,
    /// n × outputs × inputs.
    pub weights: &'a [f64],
    /// n × outputs.
    pub biases: &'a [f64],
}

/// One network per robot, all of the same shape, or one for all: hidden layers with tanh, actions limited to ±1.
/// Without hidden layers they are linear policies. Weights are rounded to f32.
#[derive(Clone, Debug)]
pub struct Networks {
    len: usize,
    /// Of the observation, of each hidden layer, and of the action.
    widths: Vec<usize>,
    numbers: Numbers,
}

/// Numbers of networks; of each output its bias, then its weights.
#[derive(Clone, Debug)]
enum Numbers {
    /// Of each eight robots the numbers of their networks, side by side.
    Each(Vec<[f32; EIGHT]>),
    Shared(Vec<f32>),
}

impl Networks {
    /// Networks of `n` robots from their layers: the first layer is on the observation, the last gives the action.
    ///
    /// # Errors
    /// [`Error::Inconsistent`] if there is no layer, or layers that do not fit each other or the action;
    /// [`Error::Length`] for a wrong count of numbers; [`Error::OutOfRange`] for a number that is not within ±1e9;
    /// [`Error::Memory`] if there is not enough memory.
    pub fn new(n: usize, layers: &[Layer<'_>]) -> Result<Self> {
        let widths = widths(n, layers)?;
        let per_robot = count(layers);
        let mut numbers: Vec<[f32; EIGHT]> = try_zeros("the weights", &[n.div_ceil(EIGHT), per_robot])?;
        for robot in 0..n {
            let group = &mut numbers[robot / EIGHT * per_robot..];
            for (from, to) in numbers_of(layers, robot).zip(group) {
                to[robot % EIGHT] = from;
            }
        }
        Ok(Self { len: n, widths, numbers: Numbers::Each(numbers) })
    }

    /// One network for all of `n` robots, from its layers.
    ///
    /// # Errors
    /// As [`Networks::new`] for one robot.
    pub fn shared(n: usize, layers: &[Layer<'_>]) -> Result<Self> {
        let widths = widths(1, layers)?;
        let mut numbers = try_zeros("the weights", &[count(layers)])?;
        numbers.iter_mut().zip(numbers_of(layers, 0)).for_each(|(to, from)| *to = from);
        Ok(Self { len: n, widths, numbers: Numbers::Shared(numbers) })
    }

    /// Number of robots.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are no robots.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Length of an observation.
    pub fn inputs(&self) -> usize {
        self.widths[0]
    }

    /// Writes the actions of all robots, n × 3, for their observations.
    ///
    /// # Errors
    /// [`Error::Length`] for slices of the wrong length.
    pub fn act(&self, observations: &[f32], actions: &mut [f32]) -> Result<()> {
        for (name, found, width) in
            [("observations", observations.len(), self.inputs()), ("actions", actions.len(), ACTION_LEN)]
        {
            if found != self.len * width {
                return Err(Error::Length { name: name.into(), found, expected: self.len * width });
            }
        }
        let mut values = self.values();
        let rows = observations.chunks(EIGHT * self.inputs()).zip(actions.chunks_mut(EIGHT * ACTION_LEN));
        for (group, (observations, actions)) in rows.enumerate() {
            self.act_in_group(group, observations, actions, &mut values);
        }
        Ok(())
    }

    /// Scratch space for the values of all layers.
    pub(super) fn values(&self) -> Vec<Eight> {
        vec![Eight::default(); self.widths.iter().sum()]
    }

    /// [`Networks::act`] for up to eight robots, from robot 8 · `group` on.
    pub(super) fn act_in_group(&self, group: usize, observations: &[f32], actions: &mut [f32], values: &mut [Eight]) {
        for (i, row) in observations.chunks_exact(self.inputs()).enumerate() {
            values.iter_mut().zip(row).for_each(|(value, number)| value.0[i] = f64::from(*number));
        }
        let widths = &self.widths;
        match &self.numbers {
            Numbers::Each(numbers) => {
                let per_group = numbers.len() / self.len.div_ceil(EIGHT);
                run_eight(Forward { widths, numbers: &numbers[group * per_group..][..per_group], values });
            }
            Numbers::Shared(numbers) => run_eight(Forward { widths, numbers, values }),
        }
        let outputs = &values[values.len() - ACTION_LEN..];
        for (i, action) in actions.chunks_exact_mut(ACTION_LEN).enumerate() {
            action.iter_mut().zip(outputs).for_each(|(action, output)| *action = output.0[i] as f32);
        }
    }
}

/// Widths of the observation and of each layer of `n` networks.
fn widths(n: usize, layers: &[Layer<'_>]) -> Result<Vec<usize>> {
    let Some(first) = layers.first() else {
        return Err(Error::Inconsistent("policies have no layer, there must be at least 1".into()));
    };
    let mut widths = vec![first.inputs];
    for (k, layer) in layers.iter().enumerate() {
        expect(format_args!("inputs of layer {k}"), layer.inputs, widths[k])?;
        for (what, found, expected) in
            [("weights", layer.weights, n * layer.outputs * layer.inputs), ("biases", layer.biases, n * layer.outputs)]
        {
            let name = format!("{what} of layer {k}");
            if found.len() != expected {
                return Err(Error::Length { name, found: found.len(), expected });
            }
            bounded(&name, found)?;
        }
        widths.push(layer.outputs);
    }
    if let Some(k) = widths.iter().position(|width| *width == 0) {
        return Err(Error::Inconsistent(format!(
            "layer {} has no {}",
            k.saturating_sub(1),
            ["inputs", "outputs"][k.min(1)]
        )));
    }
    expect(format_args!("outputs of layer {}", layers.len() - 1), widths[layers.len()], ACTION_LEN)?;
    Ok(widths)
}

/// How many numbers a network has.
fn count(layers: &[Layer<'_>]) -> usize {
    layers.iter().map(|layer| layer.outputs * (1 + layer.inputs)).sum()
}

/// The numbers of network `robot`: of each output its bias, then its weights.
fn numbers_of(layers: &[Layer<'_>], robot: usize) -> impl Iterator<Item = f32> {
    layers.iter().flat_map(move |layer| {
        (robot * layer.outputs..(robot + 1) * layer.outputs).flat_map(|output| {
            let weights = &layer.weights[output * layer.inputs..][..layer.inputs];
            [layer.biases[output]].into_iter().chain(weights.iter().copied()).map(|number| number as f32)
        })
    })
}

fn expect(name: std::fmt::Arguments<'_>, found: usize, expected: usize) -> Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(Error::Inconsistent(format!("{name}: {found}, expected {expected}")))
}

/// Outputs that are computed together: their sums do not wait for each other.
const TOGETHER: usize = 3;

/// Networks of eight robots on their observations, which are the first values; the actions are the last.
struct Forward<'a, N> {
    widths: &'a [usize],
    numbers: &'a [N],
    values: &'a mut [Eight],
}

impl<N: Number> Forward<'_, N> {
    /// Computes the values of all layers; `load` and `store` select the lanes.
    #[inline(always)]
    fn layers<L: Lane>(&mut self, load: impl Fn(&Eight) -> L, store: impl Fn(L, &mut Eight)) {
        let mut numbers = self.numbers;
        let mut values = &mut *self.values;
        for (k, pair) in self.widths.windows(2).enumerate() {
            let is_last = k + 2 == self.widths.len();
            let (inputs, outputs) = values.split_at_mut(pair[0]);
            let (together, single) = outputs[..pair[1]].as_chunks_mut::<TOGETHER>();
            for outputs in together {
                let (own, others) = numbers.split_at(TOGETHER * (1 + inputs.len()));
                numbers = others;
                for (sum, output) in sums::<L, N, TOGETHER>(own, inputs, &load).into_iter().zip(outputs) {
                    store(limited(sum, is_last), output);
                }
            }
            for output in single {
                let (own, others) = numbers.split_at(1 + inputs.len());
                numbers = others;
                let [sum] = sums::<L, N, 1>(own, inputs, &load);
                store(limited(sum, is_last), output);
            }
            values = outputs;
        }
    }
}

/// Weights · inputs + biases of K outputs, whose numbers follow each other.
#[inline(always)]
fn sums<L: Lane, N: Number, const K: usize>(numbers: &[N], inputs: &[Eight], load: &impl Fn(&Eight) -> L) -> [L; K] {
    let mut rows = [numbers; K];
    let mut sums = [load(&numbers[0].widened()); K];
    for k in 0..K {
        rows[k] = &numbers[k * (1 + inputs.len())..][..1 + inputs.len()];
        sums[k] = load(&rows[k][0].widened());
    }
    for (i, input) in inputs.iter().enumerate() {
        let input = load(input);
        for (sum, row) in sums.iter_mut().zip(rows) {
            *sum = input.mul_add(load(&row[1 + i].widened()), *sum);
        }
    }
    sums
}

/// An output within its limits: of an action ±1, else tanh.
#[inline(always)]
fn limited<L: Lane>(sum: L, is_action: bool) -> L {
    if is_action { sum.max(sum.splat(-1.0)).min(sum.splat(1.0)) } else { tanh(sum) }
}

/// A number of networks of eight robots.
trait Number {
    /// Of each robot, in double precision.
    fn widened(&self) -> Eight;
}

impl Number for [f32; EIGHT] {
    #[inline(always)]
    fn widened(&self) -> Eight {
        let mut wide = Eight::default();
        for (wide, number) in wide.0.iter_mut().zip(self) {
            *wide = f64::from(*number);
        }
        wide
    }
}

impl Number for f32 {
    #[inline(always)]
    fn widened(&self) -> Eight {
        Eight([f64::from(*self); EIGHT])
    }
}

impl<N: Number> Kernel for Forward<'_, N> {
    #[inline(always)]
    fn run<V: Registers>(mut self, simd: V) {
        self.layers::<Wide<V>>(
            #[inline(always)]
            |eight| Lane::load(simd, eight),
            #[inline(always)]
            |value, eight| value.store(eight),
        );
    }

    fn run_one_by_one(mut self) {
        for i in 0..EIGHT {
            self.layers::<f64>(|eight| Lane::load(Scalar, &eight.0[i]), |value, eight| eight.0[i] = value);
        }
    }
}
