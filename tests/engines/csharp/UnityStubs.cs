// SPDX-License-Identifier: Apache-2.0
// The parts of UnityEngine that clients/csharp/Unity names, with hardly any behaviour but that they note what they are told: the
// compiler finds misspelt names with them, and a test what the component sets. Nothing of Unity is tested.
using System;

namespace UnityEngine
{
    public class Object { public static void Destroy(Object obj) { } }
    public class Component : Object { public Transform transform; public GameObject gameObject; }
    public class MonoBehaviour : Component { }
    public class Transform : Component { public Quaternion localRotation; public void SetParent(Transform parent, bool worldPositionStays) { } }
    public class GameObject : Object { public Transform transform = new Transform(); public GameObject(string name) { } public T AddComponent<T>() where T : Component, new() => new T { gameObject = this, transform = transform }; }
    public class Light : Component { public LightType type; public LightShadows shadows; public float intensity; public Color color; }
    public enum LightType { Directional }
    public enum LightShadows { None, Soft }
    public struct Color { public Color(float r, float g, float b) { } }
    public struct Vector3 { public float y; public Vector3(float x, float y, float z) { this.y = y; } public static Vector3 forward => default(Vector3); public static Vector3 up => default(Vector3); }
    public struct Quaternion { public static Quaternion LookRotation(Vector3 forward, Vector3 upwards) => default(Quaternion); }
    public static class Mathf { public static float Exp(float f) => (float)Math.Exp(f); public static float Max(float a, float b) => Math.Max(a, b); public static float Min(float a, float b) => Math.Min(a, b); public static float Abs(float f) => Math.Abs(f); }
    public static class Time { public static float deltaTime = 0.02f; }
    public static class Debug { public static int Warnings; public static string Warning; public static void LogWarning(object message, Object context) { Warnings++; Warning = message.ToString(); } }
    public static class RenderSettings { public static Rendering.AmbientMode ambientMode; public static int Probes; private static Rendering.SphericalHarmonicsL2 probe; public static Rendering.SphericalHarmonicsL2 ambientProbe { get { return probe; } set { probe = value; Probes++; } } }
    public class SerializeField : Attribute { }
    public class TooltipAttribute : Attribute { public TooltipAttribute(string text) { } }
    public class RangeAttribute : Attribute { public RangeAttribute(float min, float max) { } }
    public class AddComponentMenu : Attribute { public AddComponentMenu(string name) { } }
}

namespace UnityEngine.Rendering
{
    public enum AmbientMode { Skybox, Custom }
    public static class GraphicsSettings { public static bool lightsUseLinearIntensity; }
    public struct SphericalHarmonicsL2 { private float[] all; public float this[int rgb, int coefficient] { get { return all == null ? 0 : all[9 * rgb + coefficient]; } set { (all = all ?? new float[27])[9 * rgb + coefficient] = value; } } }
}
