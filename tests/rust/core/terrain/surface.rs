//! The surface itself, and its contact points with balls.

use super::{contact_normal, rough};
use ballbot_core::Params;
use ballbot_core::terrain::{Ground, Terrain, TerrainKind};
use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::sync::Arc;

fn hills(x: f64, y: f64) -> f64 {
    0.05 * (3.0 * x).sin() * (2.0 * y).cos() + 0.02 * (1.3 * x - 2.1 * y).cos()
}

#[test]
fn a_plane_is_exact_everywhere() {
    let plane = Terrain::plane(0.2, 0.7).unwrap();
    let gradient = [0.2_f64.tan() * 0.7_f64.cos(), 0.2_f64.tan() * 0.7_f64.sin()];
    for (x, y) in [(0.0, 0.0), (0.3, -0.9), (57.0, -3.0), (-400.0, 1000.0)] {
        let height = gradient[0] * x + gradient[1] * y;
        assert!((plane.height(x, y) - height).abs() <= 1e-13 * (1.0 + height.abs()));
        assert!((plane.slope_at(x, y) - 0.2).abs() < 1e-14);
        assert!(plane.contains(x, y));
    }
    assert_eq!(plane.as_plane().map(|[x, y]| (x.hypot(y).atan() * 1e12).round()), Some(0.2e12));
}

#[test]
fn a_surface_goes_through_its_heights_and_converges_with_the_fourth_power_of_the_cell() {
    let mut last = f64::INFINITY;
    for cells in [20, 40, 80] {
        let cell = 4.0 / f64::from(cells);
        let terrain = Terrain::from_function(hills, [4.0, 4.0], cell).unwrap();
        assert!((terrain.height(cell, -3.0 * cell) - hills(cell, -3.0 * cell)).abs() < 1e-14);
        // Away from the edges, where the curvature is set to zero.
        let error = (0..200)
            .map(|i| {
                let (x, y) = (-0.7 + 0.007 * f64::from(i), 0.6 - 0.0061 * f64::from(i));
                (terrain.height(x, y) - hills(x, y)).abs()
            })
            .fold(0.0, f64::max);
        assert!(error < last / 12.0, "{cells} cells: {error}, before {last}");
        last = error;
    }
}

#[test]
fn gradients_and_curvatures_are_the_derivatives_of_the_height() {
    let terrain = Terrain::from_function(hills, [3.0, 2.0], 0.05).unwrap();
    let step = 1e-5;
    // On the surface, beyond one edge, beyond a corner; between nodes, where third derivatives are continuous.
    for (x, y) in [(0.21, -0.33), (-1.21, 0.88), (1.9, 0.31), (-0.41, -1.6), (2.0, 1.7)] {
        let [gx, gy] = terrain.gradient(x, y);
        let by_x = (terrain.height(x + step, y) - terrain.height(x - step, y)) / (2.0 * step);
        let by_y = (terrain.height(x, y + step) - terrain.height(x, y - step)) / (2.0 * step);
        assert!((gx - by_x).abs() < 1e-8 && (gy - by_y).abs() < 1e-8, "{x}, {y}: {gx} {by_x}, {gy} {by_y}");
        let change = |x: f64, y: f64, axis: usize| terrain.gradient(x, y)[axis];
        let by_differences = [
            (change(x + step, y, 0) - change(x - step, y, 0)) / (2.0 * step),
            (change(x, y + step, 0) - change(x, y - step, 0)) / (2.0 * step),
            (change(x, y + step, 1) - change(x, y - step, 1)) / (2.0 * step),
        ];
        for (exact, found) in terrain.surface().jet(x, y).hessian.into_iter().zip(by_differences) {
            assert!((exact - found).abs() < 1e-7, "{x}, {y}: {exact} {found}");
        }
    }
    // A sphere from below has its curvature in all directions.
    let bowl = Terrain::from_function(|x, y| 2.0 - (4.0 - x * x - y * y).sqrt(), [1.0, 1.0], 0.01).unwrap();
    for (x, y) in [(0.0, 0.0), (0.2, -0.1)] {
        let [larger, smaller] = bowl.curvatures_at(x, y);
        assert!((larger - 0.5).abs() < 1e-4 && (smaller - 0.5).abs() < 1e-4, "{larger} {smaller}");
    }
    assert!((0.5..0.7).contains(&bowl.curvature()[0]), "{:?}", bowl.curvature());
}

#[test]
fn the_gradient_is_continuous_beyond_the_edges() {
    let terrain = Terrain::from_function(hills, [3.0, 2.0], 0.05).unwrap();
    let step = 1e-9;
    for i in 0..400 {
        let along = -2.0 + 0.01 * f64::from(i);
        for (before, after) in [([1.5 - step, along], [1.5 + step, along]), ([along, 1.0 - step], [along, 1.0 + step])]
        {
            let ([ax, ay], [bx, by]) = (terrain.gradient(before[0], before[1]), terrain.gradient(after[0], after[1]));
            assert!((ax - bx).abs() < 1e-7 && (ay - by).abs() < 1e-7, "{before:?}: {ax} {bx}, {ay} {by}");
        }
    }
}

/// Smoothed random heights with a slope of `rise` at most between neighbors.
fn heights_at_random(seed: u64, nodes: [usize; 2], smoothed: usize, rise: f64) -> Vec<f64> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let [nx, ny] = nodes;
    let mut heights: Vec<f64> = (0..nx * ny).map(|_| rng.random_range(-1.0..1.0)).collect();
    for _ in 0..smoothed {
        let at = |i: usize, j: usize| heights[j.min(ny - 1) * nx + i.min(nx - 1)];
        let around =
            |i: usize, j: usize| at(i + 1, j) + at(i.saturating_sub(1), j) + at(i, j + 1) + at(i, j.saturating_sub(1));
        heights = (0..nx * ny).map(|k| 0.5 * at(k % nx, k / nx) + 0.125 * around(k % nx, k / nx)).collect();
    }
    let steepest = (0..nx * ny - nx).map(|k| (heights[k + nx] - heights[k]).abs()).fold(0.0, f64::max);
    heights.iter().map(|height| height * rise / steepest).collect()
}

#[test]
fn a_ball_that_reaches_into_the_valleys_has_a_ground() {
    let (mut made, mut too_narrow) = (0, 0);
    for seed in 0..200 {
        for (smoothed, rise, cell) in [(1, 0.05, 0.1), (3, 0.02, 0.02), (3, 0.3, 0.1), (8, 0.02, 0.02), (8, 0.3, 0.1)] {
            let nodes = [24, 17];
            let heights = heights_at_random(seed, nodes, smoothed, rise * cell);
            let terrain = Arc::new(Terrain::from_heights(&heights, nodes, cell).unwrap());
            if Ground::check_radius(&terrain, 0.112).is_err() {
                too_narrow += 1;
                continue;
            }
            let ground =
                Ground::new(&terrain, 0.112).unwrap_or_else(|error| panic!("{seed} {smoothed} {rise}: {error}"));
            made += 1;
            if cell > 0.05 {
                // Between nodes as far apart as the ball's radius the surface of the centers is interpolated coarsely.
                continue;
            }
            // On the edges, too, the ball touches and is nowhere below the ground.
            for (x, y) in [(-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0), (0.3, 1.0), (-1.0, 0.2)] {
                let [half_x, half_y] = terrain.half_size();
                let (center, _) = ground.ball_center(&Params::paper(), x * half_x, y * half_y);
                let nearest = (0..60 * 60)
                    .map(|k| [f64::from(k % 60 - 30) * 2e-3 + center.x, f64::from(k / 60 - 30) * 2e-3 + center.y])
                    .map(|[x, y]| (Vector3::new(x, y, terrain.height(x, y)) - center).norm())
                    .fold(f64::INFINITY, f64::min);
                assert!((nearest - 0.112).abs() < 2e-5, "{seed} {smoothed} {rise}: {nearest} at {center}");
            }
        }
    }
    assert!(made > 400 && too_narrow > 50, "{made} {too_narrow}");
}

#[test]
fn a_map_far_above_zero_is_a_ground() {
    let nodes = [40, 30];
    let heights = heights_at_random(5, nodes, 8, 0.02 * 0.02);
    for altitude in [0.0_f64, 10.0, -990.0] {
        let raised: Vec<_> = heights.iter().map(|height| height + altitude).collect();
        for cell in [0.02_f64, 0.001] {
            let low: Vec<_> =
                raised.iter().map(|height| altitude + (height - altitude) * (cell / 0.02).powi(2)).collect();
            let terrain = Arc::new(Terrain::from_heights(&low, nodes, cell).unwrap());
            let ground = Ground::new(&terrain, 0.112).unwrap();
            let (center, normal) = ground.ball_center(&Params::paper(), 0.1 * cell, 0.3 * cell);
            let touched = center - normal * 0.112;
            let gap = touched.z - terrain.height(touched.x, touched.y);
            assert!(gap.abs() < 1e-3 * cell, "{altitude} {cell}: {gap}");
        }
    }
}

#[test]
fn balls_touch_the_surface_at_their_radius() {
    let (params, terrain) = (rough(), Arc::new(Terrain::from_function(hills, [4.0, 4.0], 0.02).unwrap()));
    let ground = Ground::new(&terrain, params.ball_radius).unwrap();
    for i in 0..50 {
        let (x, y) = (-1.3 + 0.05 * f64::from(i), 0.9 - 0.037 * f64::from(i));
        let (center, normal) = ground.ball_center(&params, x, y);
        // The nearest point of the surface, by a search on a grid around the point of contact.
        let touched = center - normal * params.ball_radius;
        let nearest = (-40..=40)
            .flat_map(|i| (-40..=40).map(move |j| (f64::from(i) * 1e-4, f64::from(j) * 1e-4)))
            .map(|(dx, dy)| {
                let (x, y) = (touched.x + dx, touched.y + dy);
                (Vector3::new(x, y, terrain.height(x, y)) - center).norm()
            })
            .fold(f64::INFINITY, f64::min);
        assert!((nearest - params.ball_radius).abs() < 1e-7, "{x}, {y}: {nearest}");
        assert!((normal - contact_normal(&terrain, &params, &center)).norm() < 1e-5);
        let (gap, _) = ground.gap(&(center + normal * 1e-3), params.ball_radius);
        assert!((gap - 1e-3).abs() < 1e-6, "{gap}");
    }
}

#[test]
fn a_ball_of_another_radius_touches_to_the_second_order() {
    let terrain = Arc::new(Terrain::from_function(hills, [4.0, 4.0], 0.02).unwrap());
    let radius = Params::paper().ball_radius;
    let ground = Ground::new(&terrain, radius).unwrap();
    for change in [0.02, -0.01] {
        let params = Params { ball_radius: radius * (1.0 + change), ..Params::paper() };
        let exact = Ground::new(&terrain, params.ball_radius).unwrap();
        let (about, _) = ground.ball_center(&params, 0.4, 0.3);
        let (center, _) = exact.ball_center(&params, 0.4, 0.3);
        assert!((about.z - center.z).abs() < 0.5 * terrain.curvature()[1] * (radius * change).powi(2) + 1e-6);
    }
}

#[test]
fn every_kind_has_the_requested_slope() {
    // Posts are on level ground.
    for kind in TerrainKind::ALL.into_iter().filter(|kind| kind.name != "posts") {
        for slope in [0.05, 0.15] {
            let coarse: &[_] = match kind.name {
                "plane" => &[],
                "levels" | "hills" => &[("cell", 0.05), ("tile", 6.0)],
                _ => &[("cell", 0.02)],
            };
            let parameters: Vec<_> = coarse.iter().copied().chain([("slope", slope)]).collect();
            let terrain = Terrain::generate(kind.name, 3, &parameters).unwrap();
            let recipe = terrain.recipe().unwrap();
            assert_eq!(Terrain::generate(recipe.kind, recipe.seed, &recipe.parameters).unwrap(), terrain);
            let found = terrain.slope();
            let most = match kind.name {
                // A percentile, of any seed; and hollows that overlap.
                "noise" | "hills" => 2.0,
                "bumps" | "levels" => 2.5,
                "mix" => 1.5,
                _ => 1.02,
            };
            let least = if kind.name == "mix" { 0.4 } else { 0.9 };
            assert!(found > least * slope && found < most * slope, "{}: {found} for {slope}", kind.name);
            assert!(terrain.heights()[0] <= terrain.heights()[1]);
        }
        let flat = Terrain::generate(kind.name, 3, &[("slope", 1e-9)]).unwrap();
        assert!(flat.slope() < 1e-8);
    }
}

#[test]
fn noise_has_its_percentile_over_all_seeds_and_the_same_terrain_for_one() {
    let requested = 0.2;
    let mut slopes = Vec::new();
    for seed in 0..12 {
        let terrain = Terrain::generate("noise", seed, &[("slope", requested), ("cell", 0.05)]).unwrap();
        for i in 0..60 {
            for j in 0..60 {
                slopes.push(terrain.slope_at(-3.9 + 0.13 * f64::from(i), -3.9 + 0.13 * f64::from(j)));
            }
        }
    }
    slopes.sort_by(f64::total_cmp);
    let percentile = slopes[slopes.len() * 95 / 100];
    assert!((percentile / requested - 1.0).abs() < 0.03, "{percentile}");

    let make = |seed: u64| Terrain::generate("noise", seed, &[("cell", 0.05)]).unwrap();
    assert_eq!(make(5), make(5));
    assert_ne!(make(5).fingerprint(), make(6).fingerprint());
    // The same numbers on every machine.
    assert_eq!((make(5).height(0.3, -0.2) * 1e12).round(), -19_290_625_230.0);
}

#[test]
fn an_apron_is_level() {
    for kind in ["noise", "bumps", "cobbles", "mix", "wave"] {
        let terrain = Terrain::generate(kind, 1, &[("apron", 0.4), ("slope", 0.2)]).unwrap();
        for (x, y) in [(0.0, 0.0), (0.2, 0.2), (-0.3, 0.1)] {
            assert!(terrain.height(x, y).abs() < 1e-6, "{kind}: {}", terrain.height(x, y));
        }
        assert!(terrain.slope() > 0.15);
    }
    let error = Terrain::generate("noise", 1, &[("apron_blend", 1.0)]).unwrap_err();
    assert!(error.to_string().contains("apron_blend = 1 has no effect without an apron"), "{error}");
}

#[test]
fn invalid_values_are_rejected_with_value_and_limit() {
    let rejected = |result: ballbot_core::Result<Terrain>, words: &[&str]| {
        let message = result.unwrap_err().to_string();
        for word in words {
            assert!(message.contains(word), "{message} lacks {word}");
        }
    };
    rejected(Terrain::plane(1.3, 0.0), &["slope", "1.3", "1.05"]);
    rejected(Terrain::plane(0.1, f64::NAN), &["direction", "NaN"]);
    rejected(Terrain::from_heights(&[0.0; 12], [4, 4], 0.1), &["heights", "12", "16"]);
    rejected(Terrain::from_heights(&[0.0; 9], [3, 3], 0.1), &["heights along x", "3", "4"]);
    rejected(Terrain::from_heights(&[f64::NAN; 16], [4, 4], 0.1), &["heights[0, 0]", "NaN"]);
    rejected(Terrain::from_heights(&[0.0; 16], [4, 4], -0.1), &["cell", "-0.1"]);
    rejected(Terrain::from_function(|x, _| 5.0 * x, [2.0, 2.0], 0.1), &["slope", "1.373", "1.05"]);
    rejected(Terrain::from_function(|_, _| 0.0, [1e6, 1e6], 1e-3), &["at most"]);
    rejected(Terrain::from_function(|_, _| 0.0, [0.0, 1.0], 0.1), &["size along x", "0"]);
    rejected(Terrain::generate("lava", 0, &[]), &["lava", "noise"]);
    rejected(Terrain::generate("wave", 0, &[("heigth", 1.0)]), &["heigth", "wavelength"]);
    rejected(Terrain::generate("noise", 0, &[("octaves", 2.5)]), &["octaves", "2.5"]);
    rejected(Terrain::generate("wave", 0, &[("wavelength", 0.0)]), &["wavelength", "0"]);
    rejected(
        Terrain::generate("bumps", 0, &[("density", 1e3), ("size_x", 100.0), ("cell", 0.1)]),
        &["bumps", "100000"],
    );

    rejected(Terrain::generate("wave", 0, &[("wavelength", 0.09)]), &["0.09", "cell = 0.02", "5 cells"]);
    rejected(Terrain::generate("noise", 0, &[("octaves", 6.0)]), &["0.0312", "cell = 0.02"]);
    rejected(Terrain::from_coefficients(&[0.0; 36], [4, 5], 0.1), &["coefficients", "36", "42"]);
    let copied = Terrain::from_function(hills, [1.0, 0.8], 0.1).unwrap();
    let surface = copied.surface();
    let again = Terrain::from_coefficients(surface.coefficients(), surface.nodes(), surface.cell()).unwrap();
    assert_eq!(again, copied);

    let valley = Arc::new(Terrain::generate("wave", 0, &[("wavelength", 0.2), ("slope", 0.3)]).unwrap());
    let message = Ground::new(&valley, 0.112).unwrap_err().to_string();
    let curvature = format!("{:.3}", valley.curvature()[0]);
    assert!(message.contains(&curvature) && message.contains("4.464"), "{message}");
}

#[test]
fn rays_meet_the_ground() {
    let terrain = Terrain::from_function(hills, [4.0, 4.0], 0.02).unwrap();
    for i in 0..200 {
        let angle = 0.1 * f64::from(i);
        let origin = Vector3::new(0.5 * angle.cos(), 0.7 * angle.sin(), 0.4);
        let direction = Vector3::new((2.3 * angle).cos(), (2.3 * angle).sin(), -0.05 - 0.004 * f64::from(i));
        let hit = terrain.cast(&origin, &direction, f64::INFINITY);
        // The same by small steps.
        let walked = (0..400_000).map(|k| f64::from(k) * 2e-5).find(|share| {
            let at = origin + direction * *share;
            !terrain.contains(at.x, at.y) || at.z < terrain.height(at.x, at.y)
        });
        let walked = walked.filter(|share| {
            let at = origin + direction * *share;
            terrain.contains(at.x, at.y)
        });
        match (hit, walked) {
            (Some((share, normal)), Some(walked)) => {
                assert!((share - walked).abs() < 3e-5, "ray {i}: {share}, walked {walked}");
                let at = origin + direction * share;
                assert!((normal - terrain.normal(at.x, at.y)).norm() < 1e-9);
            }
            (None, None) => (),
            (hit, walked) => panic!("ray {i}: {hit:?}, walked {walked:?}"),
        }
    }
    let plane = Terrain::plane(0.3, 0.0).unwrap();
    let (share, _) = plane.cast(&Vector3::new(0.0, 0.0, 2.0), &Vector3::new(1.0, 0.0, -1.0), f64::INFINITY).unwrap();
    assert!((share - 2.0 / (1.0 + 0.3_f64.tan())).abs() < 1e-12);
    assert!(plane.cast(&Vector3::new(0.0, 0.0, 2.0), &Vector3::new(-1.0, 0.0, 0.0), f64::INFINITY).is_none());
    assert!(terrain.cast(&Vector3::new(0.0, 0.0, 2.0), &Vector3::z(), f64::INFINITY).is_none());
    assert!(terrain.cast(&Vector3::new(9.0, 0.0, 2.0), &-Vector3::z(), f64::INFINITY).is_none());
}

#[test]
fn the_limits_of_a_slope_match_the_presets() {
    let degrees = |angle: f64| (angle.to_degrees() * 10.0).round() / 10.0;
    let limits = Params::paper().slope_limits(20_f64.to_radians()).unwrap();
    assert_eq!([degrees(limits.fall), degrees(limits.traction), degrees(limits.motor)], [15.3, 15.0, 90.0]);
    let robot = Params::preset("asroballet").unwrap().slope_limits(20_f64.to_radians()).unwrap();
    assert_eq!([degrees(robot.fall), degrees(robot.traction), degrees(robot.motor)], [90.0, 15.1, 15.3]);
    assert!((limits.smallest() - limits.traction).abs() < 1e-15);
    assert!(Params::paper().slope_limits(0.0).unwrap_err().to_string().contains("fall_tilt"));
}
