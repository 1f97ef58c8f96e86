// Times Embree on what the example beside_embree wrote, which also compiles and starts this.
//
// embree SOUP RAYS robust|fast closest|any RUNS
//   SOUP: u32 count, then 9 f32 a triangle. RAYS: origin, tmin, direction, tmax: 8 f32 a ray. Little endian.
// Prints: build seconds, the best run's nanoseconds a ray, hits, sum of t of closest hits.
#include <embree3/rtcore.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <vector>

static double now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

static std::vector<char> read(const char *path) {
    FILE *file = fopen(path, "rb");
    if (!file) { perror(path); exit(1); }
    fseek(file, 0, SEEK_END);
    std::vector<char> bytes(ftell(file));
    rewind(file);
    if (fread(bytes.data(), 1, bytes.size(), file) != bytes.size()) { perror(path); exit(1); }
    fclose(file);
    return bytes;
}

int main(int count, char **words) {
    if (count != 6) { fprintf(stderr, "usage: embree SOUP RAYS robust|fast closest|any RUNS\n"); return 2; }
    const std::vector<char> soup = read(words[1]), rays = read(words[2]);
    const bool robust = !strcmp(words[3], "robust"), any = !strcmp(words[4], "any");
    uint32_t triangles;
    memcpy(&triangles, soup.data(), 4);

    RTCDevice device = rtcNewDevice("threads=1,set_affinity=0");
    const double began = now();
    RTCScene scene = rtcNewScene(device);
    rtcSetSceneFlags(scene, robust ? RTC_SCENE_FLAG_ROBUST : RTC_SCENE_FLAG_NONE);
    rtcSetSceneBuildQuality(scene, RTC_BUILD_QUALITY_MEDIUM);
    RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
    void *corners = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, 3ull * triangles);
    memcpy(corners, soup.data() + 4, 36ull * triangles);
    auto *index =
        (unsigned *)rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, triangles);
    for (uint32_t i = 0; i < 3 * triangles; ++i) index[i] = i;
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcCommitScene(scene);
    const double built = now() - began;

    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    const size_t n = rays.size() / 32;
    const float *all = (const float *)rays.data();
    double best = 1e30, sum = 0;
    size_t hits = 0;
    for (int run = 0; run < atoi(words[5]); ++run) {
        hits = 0, sum = 0;
        const double start = now();
        for (size_t i = 0; i < n; ++i) {
            const float *r = all + 8 * i;
            RTCRayHit hit;
            hit.ray.org_x = r[0], hit.ray.org_y = r[1], hit.ray.org_z = r[2], hit.ray.tnear = r[3];
            hit.ray.dir_x = r[4], hit.ray.dir_y = r[5], hit.ray.dir_z = r[6], hit.ray.tfar = r[7];
            hit.ray.time = 0, hit.ray.mask = ~0u, hit.ray.id = 0, hit.ray.flags = 0;
            if (any) {
                rtcOccluded1(scene, &context, &hit.ray);
                hits += hit.ray.tfar < 0;
            } else {
                hit.hit.geomID = hit.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
                rtcIntersect1(scene, &context, &hit);
                if (hit.hit.geomID != RTC_INVALID_GEOMETRY_ID) ++hits, sum += hit.ray.tfar;
            }
        }
        best = std::min(best, (now() - start) / n * 1e9);
    }
    printf("%.6f %.3f %zu %.9g\n", built, best, hits, sum);
    rtcReleaseGeometry(geometry);
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
}
