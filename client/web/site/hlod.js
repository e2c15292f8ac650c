// The viewer of triangles and points, which is fetched instead of the others when a page shows them (m=hlod).
export {default} from "client_web_hlod.js";
