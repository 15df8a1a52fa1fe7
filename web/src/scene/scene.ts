/** The robot in three dimensions: its URDF, moving as the robot does, over a textured ground. */

import * as THREE from 'three'
import { OrbitControls } from 'three/addons/controls/OrbitControls.js'
import { STLLoader } from 'three/addons/loaders/STLLoader.js'
import URDFLoader from 'urdf-loader'
import type { URDFJoint, URDFRobot } from 'urdf-loader'
import { seededRandom } from '../seeded-random.ts'
import { colour } from '../shell/theme.ts'
import type { Robot, State } from '../wire.ts'
import { frustumLines } from './frustum.ts'
import { say } from '../say.ts'

const GROUND_M = 400
/** Of the pixels along each side, on a device that is too slow for all of them. */
const SLOW_RATIO = 0.5
const TEXTURE_M = 4

export interface Joint {
  name: string
  lower: number
  upper: number
  unit: 'rad' | 'm'
}

export interface SceneShown {
  pose: [x: number, y: number, yaw: number]
  eye: number[]
  pictures: number
  triangles: number
  joints: Record<string, number>
  axes: number[][]
  camera: boolean
}

export class Scene {
  readonly renderer: THREE.WebGLRenderer
  robot: URDFRobot | null = null
  follow = true
  private readonly scene = new THREE.Scene()
  private readonly eye = new THREE.PerspectiveCamera(45, 1, 0.05, 500)
  private readonly orbit: OrbitControls
  private readonly body = new THREE.Group()
  private readonly frustum = new THREE.Group()
  private axes: THREE.AxesHelper[] = []
  private readonly ground: THREE.Mesh
  private readonly resize: ResizeObserver
  private frame = 0
  private readonly lastAt = new THREE.Vector3()

  constructor(private readonly host: HTMLElement) {
    this.renderer = new THREE.WebGLRenderer({ antialias: true })
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio))
    this.renderer.domElement.setAttribute('role', 'img')
    this.renderer.domElement.setAttribute('aria-label', say('robotIn3D'))
    this.renderer.domElement.addEventListener('webglcontextrestored', () => this.request())
    host.append(this.renderer.domElement)
    this.eye.up.set(0, 0, 1)
    this.eye.position.set(1.9, -2.3, 1.5)
    this.orbit = new OrbitControls(this.eye, this.renderer.domElement)
    this.orbit.target.set(0, 0, 0.35)
    this.orbit.maxPolarAngle = Math.PI / 2 - 0.02
    this.orbit.addEventListener('change', () => this.request())
    this.ground = groundPlane()
    const sun = new THREE.DirectionalLight('#fff6e0', 2.2)
    sun.position.set(4, -3, 8)
    this.scene.add(new THREE.HemisphereLight('#ffffff', '#8a7b60', 1.9), sun, this.ground, this.body)
    this.body.add(this.frustum)
    this.recolour()
    this.resize = new ResizeObserver(() => this.fit())
    this.resize.observe(host)
    this.fit()
  }

  /** Draw fewer pixels on a device that is too slow. */
  drawLess(): void {
    this.renderer.setPixelRatio(this.renderer.getPixelRatio() * SLOW_RATIO)
    this.fit()
  }

  recolour(): void {
    this.scene.background = new THREE.Color(colour('scene-sky') || '#dfe7ea')
    this.scene.fog = new THREE.Fog(this.scene.background, 20, 90)
    this.request()
  }

  /** Load the robot's description and meshes; resolves with its movable joints. */
  async load(about: Robot): Promise<Joint[]> {
    const loader = new URDFLoader()
    loader.packages = (name) => `/robot/${name}`
    loader.loadMeshCb = (path, _manager, material, done) => {
      new STLLoader().load(
        path,
        (geometry) => {
          done(new THREE.Mesh(geometry, material))
          this.request()
        },
        undefined,
        (error) => done(new THREE.Object3D(), error as Error),
      )
    }
    this.robot = await loader.loadAsync(about.urdf_url)
    this.body.add(this.robot)
    this.request()
    if (about.camera) this.frustum.add(frustumLines(about.camera, colour('focus')))
    return Object.values(this.robot.joints)
      .filter((joint) => joint.jointType !== 'fixed')
      .map(movable)
  }

  /** Axes at every link, moving with it: x red, y green, z blue. */
  showFrames(show: boolean): void {
    for (const axes of this.axes) axes.removeFromParent()
    this.axes = []
    for (const link of show && this.robot ? Object.values(this.robot.links) : []) {
      const axes = new THREE.AxesHelper(0.18)
      link.add(axes)
      this.axes.push(axes)
    }
    this.request()
  }

  showFrustum(show: boolean): void {
    this.frustum.visible = show
    this.request()
  }

  setJoint(name: string, value: number): void {
    if (this.robot?.setJointValue(name, value)) this.request()
  }

  /** Put the robot where the state says; the ground slides below it in steps of its texture. */
  update(state: State, wheels: string[]): void {
    wheels.forEach((name, i) => this.setJoint(name, state.joints_rad[i] ?? 0))
    if (!state.pose) return
    const [x, y, yaw] = state.pose
    const moved = new THREE.Vector3(x, y, 0)
    if (!moved.equals(this.body.position) || yaw !== this.body.rotation.z) this.request()
    this.body.position.copy(moved)
    this.body.rotation.z = yaw
    if (this.follow) {
      const step = moved.clone().sub(this.lastAt)
      this.eye.position.add(step)
      this.orbit.target.add(step)
    }
    this.lastAt.copy(moved)
    this.ground.position.set(Math.round(x / TEXTURE_M) * TEXTURE_M, Math.round(y / TEXTURE_M) * TEXTURE_M, 0)
  }

  /** What is shown, for tests: pictures of a scene differ from one graphics card to the next. */
  shown(): SceneShown {
    const { x, y } = this.body.position
    const meshes: THREE.Mesh[] = []
    this.robot?.traverse((part) => {
      if (part instanceof THREE.Mesh && part.geometry instanceof THREE.BufferGeometry) meshes.push(part)
    })
    return {
      pose: [x, y, this.body.rotation.z],
      eye: this.eye.position.toArray(),
      pictures: this.renderer.info.render.frame,
      triangles: meshes.reduce((sum, mesh) => sum + (mesh.geometry.getAttribute('position')?.count ?? 0) / 3, 0),
      joints: Object.fromEntries(
        Object.values(this.robot?.joints ?? {}).map((joint) => [joint.urdfName, Number(joint.jointValue[0] ?? 0)]),
      ),
      axes: this.axes.map((axes) => axes.getWorldPosition(new THREE.Vector3()).toArray()),
      camera: this.frustum.visible && this.frustum.children.length > 0,
    }
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.host
    if (!width || !height) return
    this.renderer.setSize(width, height, false)
    this.eye.aspect = width / height
    this.eye.updateProjectionMatrix()
    this.request()
  }

  /** Draw the next frame: a scene in which nothing moves costs a tablet nothing. */
  private request(): void {
    this.frame ||= requestAnimationFrame(() => {
      this.orbit.update()
      this.renderer.render(this.scene, this.eye)
      this.frame = 0
    })
  }

  close(): void {
    cancelAnimationFrame(this.frame)
    this.resize.disconnect()
    this.orbit.dispose()
    this.renderer.dispose()
    this.renderer.forceContextLoss()
    this.renderer.domElement.remove()
  }
}

/** A joint with its limits; without any it turns once around. */
function movable(joint: URDFJoint): Joint {
  const { lower, upper } = joint.limit
  const isLimited = joint.jointType !== 'continuous' && upper > lower
  return {
    name: joint.urdfName,
    lower: isLimited ? lower : -Math.PI,
    upper: isLimited ? upper : Math.PI,
    unit: joint.jointType === 'prismatic' ? 'm' : 'rad',
  }
}

/** Soil with a line every metre, painted on a texture: thin line geometry shimmers and vanishes near the eye. */
function groundPlane(): THREE.Mesh {
  const px = 512
  const canvas = document.createElement('canvas')
  canvas.width = canvas.height = px
  const pen = canvas.getContext('2d')
  if (pen) {
    pen.fillStyle = '#8d7a60'
    pen.fillRect(0, 0, px, px)
    const next = seededRandom(99)
    for (let i = 0; i < 5000; i++) {
      pen.fillStyle = next() > 0.5 ? 'rgb(60 48 34 / 22%)' : 'rgb(190 170 138 / 22%)'
      const size = 1 + 3 * next()
      pen.fillRect(next() * px, next() * px, size, size)
    }
    pen.strokeStyle = 'rgb(40 32 22 / 55%)'
    pen.lineWidth = 3
    for (let i = 0; i <= TEXTURE_M; i++) {
      const at = (i * px) / TEXTURE_M
      pen.beginPath()
      pen.moveTo(at, 0)
      pen.lineTo(at, px)
      pen.moveTo(0, at)
      pen.lineTo(px, at)
      pen.stroke()
    }
  }
  const texture = new THREE.CanvasTexture(canvas)
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping
  texture.repeat.set(GROUND_M / TEXTURE_M, GROUND_M / TEXTURE_M)
  texture.anisotropy = 8
  texture.colorSpace = THREE.SRGBColorSpace
  return new THREE.Mesh(new THREE.PlaneGeometry(GROUND_M, GROUND_M), new THREE.MeshLambertMaterial({ map: texture }))
}
