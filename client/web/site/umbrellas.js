// The viewer of points and umbrellas, which is fetched instead of the others when a page shows them (m=pmr).
export {default} from "client_web_umbrellas.js";
