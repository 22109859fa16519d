//! Levels of a curriculum.

use ballbot_core::batch::Levels;
use ballbot_core::terrain::Tiles;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

#[test]
fn curricula_climb_level_by_level_and_then_go_everywhere() {
    let tiles = Tiles { columns: 4, levels: 3, side: 8.0 };
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut reached = 0;
    for level in 0..3 {
        assert_eq!(Levels::Curriculum.draw(&tiles, &mut reached, &mut rng)[1], level);
        assert_eq!(Levels::after(reached, 0.6, false), level as u32);
        reached = Levels::after(reached, 0.9, false);
    }
    let mut seen = [0; 3];
    for _ in 0..300 {
        reached = 3;
        seen[Levels::Curriculum.draw(&tiles, &mut reached, &mut rng)[1]] += 1;
    }
    assert!(seen.iter().all(|count| *count > 60), "{seen:?}");
    assert_eq!(Levels::after(2, 0.9, true), 1);
    assert_eq!(Levels::after(2, 0.3, false), 1);
    assert_eq!(Levels::after(0, 0.3, false), 0);
}
