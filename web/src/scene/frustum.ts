import * as THREE from 'three'
import type { Robot } from '../wire.ts'

const REACH_M = 0.8
const USUAL_HFOV_RAD = 1.1

/** The camera's field of view as a pyramid, in the body frame. Camera frame: x right, y down, z forward. */
export function frustumLines(camera: NonNullable<Robot['camera']>, colour: string): THREE.LineSegments {
  const halfX = Math.tan((camera.hfov_rad ?? USUAL_HFOV_RAD) / 2) * REACH_M
  const halfY = (halfX * camera.height_px) / camera.width_px
  const corners = [
    [-halfX, -halfY],
    [halfX, -halfY],
    [halfX, halfY],
    [-halfX, halfY],
  ].map(([x, y]) => new THREE.Vector3(x, y, REACH_M))
  const points: THREE.Vector3[] = []
  corners.forEach((corner, i) => points.push(new THREE.Vector3(), corner, corner, corners[(i + 1) % 4]))
  const lines = new THREE.LineSegments(
    new THREE.BufferGeometry().setFromPoints(points),
    new THREE.LineBasicMaterial({ color: colour }),
  )
  lines.applyMatrix4(new THREE.Matrix4().fromArray(camera.body_from_camera).transpose())
  return lines
}
