// The viewer of splats, which is fetched instead of the others when a page shows splats (m=qsplat).
export {default} from "client_web_splats.js";
