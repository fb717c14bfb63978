// SPDX-License-Identifier: Apache-2.0
using System;
using System.Collections.Generic;
using Lightprobe.Messages;

namespace Lightprobe
{
    /// <summary>
    /// Refuses numbers that no light has, so that no NaN reaches a renderer. Such a message is a WireException, which names the
    /// field; the client then closes the connection. May be called by any thread.
    /// </summary>
    internal static class MessageCheck
    {
        private const int HighestOrder = 8;
        /// <summary>How far the length of a unit vector may be from 1.</summary>
        private const double LengthTolerance = 1e-3;

        /// <exception cref="WireException">A number is impossible.</exception>
        internal static void Check(FromProbe message)
        {
            if (message.Estimate != null) CheckEstimate(message.Estimate);
            if (message.ReflectionMap != null) CheckReflectionMap(message.ReflectionMap);
        }

        private static void CheckEstimate(Estimate estimate)
        {
            foreach (Light light in estimate.Lights) CheckLight(light);
            if (estimate.Key != null) CheckLight(estimate.Key);
            CheckSh(estimate.Sh ?? new SphericalHarmonics());
            if (estimate.Frame > EstimateFrame.World)
                throw new WireException("Estimate.frame: " + (uint)estimate.Frame + ", expected PROBE or WORLD");
            if (estimate.Orientation.Count > 0) CheckUnit("Estimate.orientation", estimate.Orientation, 4);
            if (estimate.CdM2PerUnit.HasValue) CheckPositive("Estimate.cd_m2_per_unit", estimate.CdM2PerUnit.Value);
        }

        private static void CheckLight(Light light)
        {
            CheckUnit("Light.direction", light.Direction, 3);
            CheckFinite("Light.irradiance", light.Irradiance, 3);
            CheckFinite("Light.angular_radius_deg", new[] { light.AngularRadiusDeg }, 1);
            if (light.HalfAngleDeg.Count > 0) CheckFinite("Light.half_angle_deg", light.HalfAngleDeg, 2);
            if (light.Axis.Count > 0) CheckFinite("Light.axis", light.Axis, 3);
        }

        private static void CheckSh(SphericalHarmonics sh)
        {
            if (sh.Basis != SphericalHarmonicsBasis.RealPositive || sh.Quantity != SphericalHarmonicsQuantity.Radiance)
                throw new WireException("SphericalHarmonics: of a basis or quantity that this client does not know");
            if (sh.Order > HighestOrder) throw new WireException("SphericalHarmonics.order: " + sh.Order + ", expected 0 to " + HighestOrder);
            CheckKind("SphericalHarmonics.kind", sh.Kind);
            int count = (int)(sh.Order + 1);
            CheckFinite("SphericalHarmonics.coefficients", sh.Coefficients, 3 * count * count);
        }

        private static void CheckReflectionMap(ReflectionMap map)
        {
            if ((map.Size != 16 && map.Size != 32 && map.Size != 64) || map.Texels.Length != 24 * map.Size * map.Size)
                throw new WireException("ReflectionMap.texels: " + map.Texels.Length + " bytes of size " + map.Size + ", expected size 16, 32 or 64");
            CheckPositive("ReflectionMap.scale", map.Scale);
            CheckKind("ReflectionMap.kind", map.Kind);
            if (map.Orientation.Count > 0) CheckUnit("ReflectionMap.orientation", map.Orientation, 4);
        }

        private static void CheckKind(string name, SphericalHarmonicsKind kind)
        {
            if (kind != SphericalHarmonicsKind.Ambient && kind != SphericalHarmonicsKind.Total)
                throw new WireException(name + ": " + (uint)kind + ", expected AMBIENT or TOTAL");
        }

        private static void CheckPositive(string name, float value)
        {
            if (!(value > 0) || float.IsInfinity(value)) throw new WireException(name + ": " + value + ", expected a positive number");
        }

        private static void CheckFinite(string name, IList<float> values, int count)
        {
            bool isFinite = true;
            foreach (float value in values) isFinite &= !float.IsNaN(value) && !float.IsInfinity(value);
            if (values.Count != count || !isFinite)
                throw new WireException(name + ": " + values.Count + " numbers, expected " + count + ", all finite");
        }

        private static void CheckUnit(string name, IList<float> values, int count)
        {
            CheckFinite(name, values, count);
            double square = 0;
            foreach (float value in values) square += (double)value * value;
            if (Math.Abs(Math.Sqrt(square) - 1) > LengthTolerance)
                throw new WireException(name + ": of length " + Math.Sqrt(square) + ", expected 1");
        }
    }
}
