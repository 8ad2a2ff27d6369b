// The thesis's chunk kernel (Alg. 2.10): every voxel of a chunk; one that is active and lies in a solid
// cell of the tool's grid is set to 0. One thread a word of two densities, one dispatch a chunk.

struct Chunk {
    origin: vec4f,   // xyz: tool cells of voxel (0, 0, 0) of the lattice
    step_x: vec4f,   // cells from voxel to voxel along x, y, z
    step_y: vec4f,
    step_z: vec4f,
    first: vec4u,    // xyz: the chunk's first voxel; w: the first of its words
    dims: vec4u,     // xyz: cells of the tool's grid
};

@group(0) @binding(0) var<storage, read_write> densities: array<u32>;
@group(0) @binding(1) var<storage, read> solid: array<u32>;  // one bit a cell
@group(0) @binding(2) var<storage, read_write> removed: atomic<u32>;
@group(0) @binding(3) var<uniform> chunk: Chunk;

fn is_removed(voxel: vec3u) -> bool {
    let v = vec3f(voxel);
    let row = chunk.origin.xyz + v.z * chunk.step_z.xyz + v.y * chunk.step_y.xyz;
    let at = row + v.x * chunk.step_x.xyz;
    if any(at < vec3f(0.0)) || any(at >= vec3f(chunk.dims.xyz)) { return false; }
    let c = vec3u(at);
    let cell = (c.z * chunk.dims.y + c.y) * chunk.dims.x + c.x;
    return ((solid[cell >> 5u] >> (cell & 31u)) & 1u) == 1u;
}

@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3u) {
    let n = 2u * id.x;
    let word = chunk.first.w + id.x;
    let voxel = chunk.first.xyz + vec3u(n & 31u, (n >> 5u) & 31u, n >> 10u);
    var both = densities[word];
    var count = 0u;
    if (both & 0xffffu) != 0u && is_removed(voxel) { both &= 0xffff0000u; count += 1u; }
    if (both >> 16u) != 0u && is_removed(voxel + vec3u(1u, 0u, 0u)) { both &= 0xffffu; count += 1u; }
    if count > 0u {
        densities[word] = both;
        atomicAdd(&removed, count);
    }
}
