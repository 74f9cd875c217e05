//! What every BSDF keeps to, and what single ones are known for.

use common::method::Fresnel;

use super::*;

fn glass(eta: f32, fresnel: Fresnel) -> Bsdf {
    let lobe = SmoothDielectric { eta, reflectance: Rgb::ONE, transmittance: Rgb::ONE, fresnel };
    Bsdf::new(Lobes::SmoothDielectric(lobe), true)
}

#[test]
fn smooth_glass_loses_nothing_and_refracts_by_snell() {
    for fresnel in [Fresnel::Exact, Fresnel::Schlick] {
        for eta in [1.0, 1.33, 1.5, 0.8] {
            for i in -1000..=1000i32 {
                let z = i as f32 / 1000.0;
                let wo = Vec3::new((1.0 - z * z).sqrt(), 0.0, z);
                let bsdf = glass(eta, fresnel);
                let reflected = bsdf.sample(wo, 0.0, Vec2::ZERO);
                let refracted = bsdf.sample(wo, 0.999_999_9, Vec2::ZERO);
                let Some((reflected, refracted)) = reflected.zip(refracted) else {
                    assert_eq!(z, 0.0);
                    continue;
                };
                for sample in [reflected, refracted] {
                    assert!(sample.delta && sample.pdf == 0.0);
                    assert!((sample.wi.length() - 1.0).abs() < 1e-5, "{eta} {z}");
                    // Chance times weight sums to R + T when each weight, freed of 1 / eta^2, is 1.
                    assert!((sample.weight.x * sample.eta * sample.eta - 1.0).abs() < 1e-6, "{eta} {z}");
                }
                if refracted.transmission {
                    assert!(refracted.wi.z * z < 0.0);
                    let ratio = if z > 0.0 { eta } else { 1.0 / eta };
                    assert_eq!(refracted.eta, ratio);
                    assert!((refracted.wi.x * ratio + wo.x).abs() < 1e-6);
                }
            }
        }
    }
}

#[test]
fn a_one_sided_surface_is_black_from_behind() {
    let lobes = Lobes::Diffuse(Diffuse { reflectance: Rgb::splat(0.5) });
    let (up, down) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.6, 0.0, -0.8));
    let one = Bsdf::new(lobes, false);
    assert!(one.sample(down, 0.5, Vec2::splat(0.5)).is_none() && one.eval(down, down) == Rgb::ZERO);
    let two = Bsdf::new(lobes, true);
    assert_eq!(two.eval(down, down), two.eval(up, up));
    assert!(two.sample(down, 0.5, Vec2::splat(0.25)).unwrap().wi.z < 0.0);
    assert_eq!((two.eval(up, down), two.pdf(up, down)), (Rgb::ZERO, 0.0));
}
